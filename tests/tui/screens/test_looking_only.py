"""Who may only look changes no robot and writes no file, whatever the key, the verb or the page."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from robotree.tui.line.action import RIGHT_NAMES, Where
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.page_keys import PAGE_KEYS, page_keys
from robotree.tui.line.surface import Surface
from robotree.tui.processes.choices import Choices
from robotree.tui.processes.layout import LayoutFile
from robotree.tui.screen.pages.help import help_text
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.pages.where import WherePage
from robotree.tui.seen.selection import Place

if TYPE_CHECKING:
    from collections.abc import Mapping

    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

HARMLESS = {"see", "", "stop"}
"""Rights of what remains: looking, and the protective stop."""
OWN_BOOK = {"take"}
"""It takes what is known of robots along, for a shell; nothing of the realm changes."""
LEAVES = {"escape", "q", "ctrl+q"}
"""Keys that leave a page: they are pressed last."""
STOPS = {BY_VERB["stop"].key, BY_VERB["stop"].typing_key}

CHANGES = (
    *("tell", "carry_out", "cancel", "pause", "step", "go_on", "control", "decide", "create", "delete"),
    *("enslave", "release", "resume", "reload", "migrate", "place", "drain", "disturb"),
)
"""What a realm client does beside calls."""


def refuse(asked: list[str], name: str, *_given: object, **_how: object) -> None:
    """Note what was asked of the realm."""
    asked.append(name)


def test_each_action_whose_right_changes_something_is_absent_where_one_may_only_look() -> None:
    assert set(RIGHT_NAMES) > HARMLESS - {"", "stop"}
    for action in ACTIONS:
        if action.right not in HARMLESS and action.verb not in OWN_BOOK:
            assert action.alters, action.verb
        if action.danger:
            assert action.alters, action.verb
        for where in Where:
            if action.alters:
                assert not Surface(where, readonly=True).has(action), action.verb


def test_what_names_a_file_to_be_written_is_for_the_shell_of_who_looks_alone() -> None:
    for action in ACTIONS:
        kept = {"--out", "FILE", "NEW"} & {*action.usage.replace("[", " ").replace("]", " ").split()}
        if kept and action.run and action.where & (Where.PROMPT | Where.SCRIPT):
            assert action.alters or action.writes, action.verb
        if action.writes:
            assert not Surface(Where.PROMPT, readonly=True).has(action), action.verb
            assert Surface(Where.SHELL, readonly=True).has(action), action.verb


def test_each_key_of_a_page_that_changes_something_names_its_verb() -> None:
    changing = {"teleop", "compose", "doing", "writing"}
    looking = {"back", "leave", "larger", "smaller", "camera", "next"}
    for key in PAGE_KEYS:
        assert not key.wants or key.wants in BY_VERB, key.id
        if key.page in changing and key.name not in looking:
            assert BY_VERB[key.wants].alters, key.id
    wanted = {key.id: key.wants for key in PAGE_KEYS}
    assert wanted["plan.go"] == "go"
    assert wanted["panel.run"] == wanted["panel.teleoperate"] == "call"
    assert wanted["readings.alarm"] == "alarm above"
    assert wanted["readings.acknowledge"] == "alarm ack"


async def every_key(operator: Operator, keys: set[str]) -> None:
    """Press keys on what is in front now, and come back to it as often as something else has come."""
    front = operator.app.screen
    for key in sorted(keys - LEAVES - STOPS):
        await operator.press(key)
        while operator.app.screen is not front or operator.app.guard.typing:
            before = operator.app.screen, operator.app.guard.typing
            await operator.press("escape")
            if (operator.app.screen, operator.app.guard.typing) == before:
                operator.app.pop_screen()


async def test_no_key_of_the_whole_program_changes_anything_where_one_may_only_look(
    realm: Realm, operate: Operate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    layout = LayoutFile(tmp_path / "here" / "screen.yaml")
    asked = list[str]()
    call, looked = realm.realm_client.call, realm.realm_client.describe

    async def called(name: str, command: str, arguments: Mapping[str, Any], **how: Any) -> Any:
        spec = (await looked(name)).command(command)
        if spec is None or spec.effect != "read":
            asked.append(f"{name}.{command}")
        return await call(name, command, arguments, **how)

    monkeypatch.setattr(realm.realm_client, "call", called)
    for name in CHANGES:
        assert hasattr(realm.realm_client, name), name
        monkeypatch.setattr(realm.realm_client, name, partial(refuse, asked, name))
    async with operate(realm.realm_client, readonly=True, layout=layout, mended=True) as operator:
        operator.app.looks.wear(Choices(tmp_path / "here" / "looks.json"), ())
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.choose("arm-1")
        letters = {action.key for action in ACTIONS if action.key and action.where & Where.SCREEN}
        every = letters | {one for key in PAGE_KEYS for one in key.key.split(",")}
        for opens in ("", "F", "v", "U", "Q", "z", "A", "P"):
            if opens:
                await operator.press(opens)
            await every_key(operator, every if opens in {"", "F"} else every - letters)
            while not isinstance(operator.app.screen, MainPage):
                operator.app.pop_screen()
            operator.app.choose("arm-1")
            await operator.press("l")
        assert asked == []
        assert operator.app.errors == []
    assert list((tmp_path / "here").iterdir()) == []


async def test_who_may_only_look_has_keys_that_look_and_the_stop_and_opens_no_page_that_changes_anything(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, readonly=True) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        page = operator.app.main
        await operator.press("C")
        await operator.sees("no verb 'compose': this is read-only")
        await operator.obey("compose")
        assert operator.app.screen is page
        operator.app.open_teleoperation(operator.app.store.descriptions["arm-1"])
        await operator.sees("no verb 'call': this is read-only")
        assert not any(isinstance(one, TeleopPage) for one in operator.app.screen_stack)
        operator.app.ask_for("compose", Place("arm-1"))
        operator.app.do("cancel", NAME="arm-1")
        await operator.sees("no verb 'cancel': this is read-only")
        assert operator.app.screen is page
        await operator.sees("realm test (read-only)")
        bound = {binding.binding.id for binding in page.active_bindings.values() if binding.enabled}
        assert bound.isdisjoint({"create", "enslave", "release", "delete", "cancel", "resume", "panel"})
        assert {"show", "stop", "help", "quit"} <= bound
        await operator.press("n", "e", "d", "enter", "R")
        assert operator.app.screen is page
        await operator.obey("delete rover-1")
        await operator.sees("no verb 'delete': this is read-only")
        shown = help_text(operator.app).plain
        assert "enslave PARENT.SLOT CHILD" not in shown
        assert "stop [NAME]" in shown
        assert all("delete" not in command.title for command in operator.app.get_system_commands(page))
        await operator.press("space")
        await operator.until(lambda: len(operator.app.store.stopped) == 2, "the stop")


async def test_the_keys_can_be_drawn_while_a_page_is_on_its_way_out(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, mended=True) as operator:
        page = operator.app.main
        await page.query_one("#panes").remove()
        assert page.active_bindings, "the line of keys is drawn once more while the screen ends"
        operator.app.exit(0)


async def test_plan_and_page_of_who_may_only_look_offer_nothing_and_say_why(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, readonly=True) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.choose("arm-1")
        await operator.press("F", "up", "up")
        await operator.until(lambda: operator.app.foresight.newest is not None, "the way")
        await operator.until(lambda: getattr(operator.app.foresight.newest, "answered", False), "the answer")
        shown = {one.binding.id for one in operator.app.screen.active_bindings.values() if one.enabled}
        assert "plan.next" in shown
        assert shown.isdisjoint({key.id for key in page_keys("plan") if key.wants == "go"})
        assert "enter: go there" not in operator.text
        assert "Go there" not in operator.text
        for key, verb in (("K", "places add"), ("1", "control get"), ("enter", "go")):
            before = len(operator.app.store.entries)
            await operator.press(key)
            told = [entry.text for entry in list(operator.app.store.entries)[before:]]
            assert any(f"no verb {verb!r}: this is read-only" in text for text in told), (key, told)
        await operator.press("l", "z")
        page = await operator.at(WherePage)
        await operator.sees(
            "arm-1 has carried nothing out yet", "no page: it is a proxy", "no call of a child"
        )
        assert not page.check_action("verb", ("pause",))
        await operator.press("b")
        assert not operator.app.store.descriptions["arm-1"].paused
