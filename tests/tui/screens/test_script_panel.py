"""What a script knows, live in its panel; and roles, chosen on the screen."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import OptionList

from robotree.tui.screen.pages import panel as panels
from robotree.tui.screen.pages.dialogs import Choosing
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.vr import command
from robotree.vr.scripts.roles import RolePlayer

from .test_panel_page import open_panel

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

COUNTS = """
script: doorman
partners: {robot: Butler}
hears: {bell: {who: text}}
facts: {count: {guests: 0}}
begin with:
  - count: {guests: 0}
rules:
  - rule: greet
    when:
      - bell: {who: $who}
      - count: {guests: $n}
        as: c
    then:
      - update c: {guests: = $n + 1}
      - do: robot.say
        with: {text: "Welcome, $who"}
  - rule: go-on
    when: [failed: {act: say}]
    then: [log: nobody spoke]
"""


class Butler(RolePlayer):
    @command
    def say(self, text: str) -> str:
        """Say something."""
        return self.manner.words(text)


async def led(realm: Realm, folder: Path) -> None:
    """Have a script lead a robot that plays roles."""
    await realm.robot(Butler("james"))
    file = folder / "doorman.yaml"
    await asyncio.to_thread(file.write_text, COUNTS)
    await realm.realm_client.create(str(file), "doorman")
    await realm.realm_client.enslave("doorman", "robot", "james")


def chosen_command(page: PanelPage) -> str:
    """Return the command whose form a panel shows; empty: none yet."""
    place = page.query_one("#commands", OptionList).highlighted
    return "" if place is None else page.robot.commands[place].name


async def test_the_panel_of_a_script_opens_at_its_start_and_shows_its_facts_and_firings_live(
    realm: Realm, operate: Operate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panels, "GLANCE", 0.1)
    await led(realm, tmp_path)
    async with operate(realm.realm_client, size=(130, 50)) as operator:
        page = await open_panel(operator, "doorman")
        await operator.until(lambda: chosen_command(page) == "start", "the command that it begins with")
        await operator.sees("rules", "ready", "it is not started")
        await realm.realm_client.tell("doorman", "start", {}, deadline=60.0)
        await operator.sees("active", "count: {guests: 0}", "fired (0)")
        await realm.realm_client.call("doorman", "bell", {"who": "Anna"})
        await operator.sees("count: {guests: 1}", "greet")
        await realm.realm_client.release("doorman", "robot")
        await operator.sees("it has ended", "released")


async def choose_role(operator: Operator, name: str) -> Choosing:
    """Press the key of roles on a robot."""
    await operator.select(name)
    await operator.until(lambda: name in operator.app.store.descriptions, "its description")
    await operator.press("p")
    return await operator.at(Choosing)


async def test_a_role_is_chosen_on_the_screen_and_the_present_one_is_marked(
    realm: Realm, operate: Operate
) -> None:
    robot = Butler("james")
    await realm.robot(robot)
    async with operate(realm.realm_client) as operator:
        dialog = await choose_role(operator, "james")
        await operator.sees("Which role does james play from its next act on?", "neutral  now", "child")
        options = dialog.query_one(OptionList)
        names = [str(option.prompt).split()[0] for option in options.options]
        assert names[0] == "neutral"
        for _ in range(names.index("butler")):
            await operator.press("down")
        await operator.press("enter")
        await operator.at(MainPage)
        await operator.sees("james plays butler from its next act on")
        assert robot.role == "butler"
        await choose_role(operator, "james")
        await operator.sees("butler  now")
        await operator.press("escape")
        await operator.at(MainPage)
        assert robot.role == "butler", "escape changes nothing"


async def test_the_role_of_a_led_robot_is_changed_through_its_script(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    await led(realm, tmp_path)
    async with operate(realm.realm_client) as operator:
        await operator.obey("role james child")
        await operator.sees("james plays child from its next act on")
        assert (await realm.realm_client.describe("james")).attributes["role"] == "child"


async def test_a_robot_without_roles_says_so(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.select("arm-1")
        await operator.press("p")
        await operator.sees("arm-1 plays no roles")
