"""An open form lives: untouched fields follow the robot, a line does the same, what runs is seen."""

from __future__ import annotations

import shlex
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Input

from robotree.tui.line import grammar
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.command_form import CommandForm
from tests.tui.screens.rows import row

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


@asynccontextmanager
async def at_go_to(
    realm: Realm, operate: Operate, robot: str = "arm-1", size: tuple[int, int] = (120, 34)
) -> AsyncIterator[tuple[Operator, PanelPage]]:
    """Open the panel of the arm at its first form, go_to."""
    async with operate(realm.realm_client, size=size) as operator:
        await operator.until(lambda: "x" in operator.app.store.readings(robot), "its readings")
        yield operator, await operator.panel(robot)


async def test_fields_that_nobody_touched_follow_the_robot_and_touched_ones_are_marked(
    realm: Realm, operate: Operate
) -> None:
    async with at_go_to(realm, operate) as (operator, page):
        realm.arm.pose |= {"x": 0.5, "y": 0.25}
        await operator.until(lambda: (row(page, "x").text, row(page, "y").text) == ("0.5", "0.25"), "both")
        await operator.press("enter")
        await operator.until(lambda: row(page, "x").query_one(Input).has_focus, "the cursor")
        await operator.press("ctrl+u", *"01")
        realm.arm.pose |= {"x": 0.55, "y": 0.1}
        await operator.sees("x *", "typed · -0.8 … 0.8 m · now 0.55")
        await operator.until(lambda: row(page, "y").text == "0.1", "y follows on")
        assert row(page, "x").text == "01"
        assert "y *" not in operator.text
        await operator.press("ctrl+n")
        await operator.until(lambda: row(page, "x").text == "0.55", "x follows again")
        assert "x *" not in operator.text


async def test_what_was_typed_stays_also_when_readings_come_before_its_message(
    realm: Realm, operate: Operate
) -> None:
    async with at_go_to(realm, operate) as (operator, page):
        x, y = row(page, "x"), row(page, "y")
        x.query_one(Input).value = "0.1"
        for moved in (0.6, 0.65):
            for field in (x, y):
                field.tell_readings({"x": moved, "y": moved})
        assert (x.text, y.text) == ("0.1", "0.65")
        await operator.settled()
        assert (x.touched, y.touched) == (True, False)


async def test_the_form_is_a_line_for_a_shell_that_can_be_copied(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied: list[str] = []
    async with at_go_to(realm, operate) as (operator, _page):
        monkeypatch.setattr(operator.app, "copy_to_clipboard", copied.append)
        await operator.press("enter", "ctrl+u", *"45", "space", *"cm")
        await operator.sees("$ robotree --realm test call arm-1.go_to 'x=45 cm' y=0 z=0.4", "twist=0deg")
        await operator.press("ctrl+y")
        await operator.sees("✓ copied: robotree")
        words = shlex.split(copied[0])
        assert words[:3] == ["robotree", "--realm", "test"]
        line = grammar.parse(words[3:], shapes(Where.SHELL), {})
        await operator.app.attempt(line)
        assert realm.arm.pose["x"] == pytest.approx(0.45), "the line does what the form would"


async def test_branch_and_picture_come_with_the_first_command_and_stay(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("teleop.py", "teleop")
    await realm.realm_client.enslave("teleop", "arm", "arm-1")
    realm.arm.under_way = True
    async with at_go_to(realm, operate, "teleop") as (operator, page):
        commands = [command.name for command in page.robot.commands]
        await operator.press("home", *["down"] * commands.index("go_to"), "ctrl+r")
        await operator.sees("teleop  ◐ go_to", "└ arm: arm-1  ◐ go_to", "cell / cell", "▀▀▀")
        assert "--%" not in operator.text
        await operator.sees("  1 s")  # how long it has run is told also where nobody says how far it is
        realm.arm.under_way = False
        await operator.sees("done in", "└ arm: arm-1", "cell / cell", "▀▀▀")
        assert any(one.seen for one in page.query(PictureView))


async def test_one_escape_leaves_the_panel_from_anywhere_and_what_runs_goes_on(
    realm: Realm, operate: Operate
) -> None:
    async with at_go_to(realm, operate) as (operator, _page):
        await operator.press("enter", "enter", "enter", "escape")
        await operator.at(MainPage)
        page = await operator.panel()
        realm.arm.under_way = True
        await operator.press("enter", "ctrl+r")
        await operator.until(lambda: page.query(CommandForm).first().running, "it runs")
        await operator.press("escape")
        await operator.at(MainPage)
        await operator.sees("arm-1.go_to goes on")
        realm.arm.under_way = False
        await operator.sees("is done: ran")
