"""An open form lives: untouched fields follow the robot, a line does the same; one that runs takes no key."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from textual.widgets import Button, Input

from robotree.tui.line import grammar
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.screen import key_guard
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.new import NewPage, SourceTree
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.command_form import CommandForm
from tests.screen import row

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

    from robotree.vr.base.description import RobotDescription


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
        x, y = row(page, "x"), row(page, "y")
        x.query_one(Input).value = "0.1"
        for moved in (0.6, 0.65):
            for field in (x, y):
                field.tell_readings({"x": moved, "y": moved})
        assert (x.text, y.text) == ("0.1", "0.65"), "readings may come before the message of it"
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


PAINTERS = '''
"""A file."""
from robotree.vr import VirtualRobot

class Painter(VirtualRobot):
    """Paints."""

class Finisher(Painter):
    """Finishes."""
'''
ENTER, ESCAPE, CTRL_R, CTRL_U = "\r", "\x1b\x1b", "\x12", "\x15"


@pytest.fixture
def slow_host(realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> asyncio.Event:
    """Offer one file, and let robots be made of it only after this is set."""
    (tmp_path / "good.py").write_text(PAINTERS)
    monkeypatch.setattr("robotree.tui.screen.pages.new.places", lambda: [("here", tmp_path)])
    go_on, create = asyncio.Event(), realm.realm_client.create

    async def wait(path: str, name: str, **options: Any) -> RobotDescription:
        await go_on.wait()
        return await create(path, name, **options)

    monkeypatch.setattr(realm.realm_client, "create", wait)
    return go_on


@asynccontextmanager
async def go_to_form(
    realm: Realm, operate: Operate
) -> AsyncIterator[tuple[Operator, PanelPage, CommandForm]]:
    """Open the panel of the arm; the cursor is in field x of go_to."""
    async with operate(realm.realm_client) as operator:
        page = await operator.panel()
        form = page.query(CommandForm).first()
        row(form, "x").focus_entry()
        await operator.until(lambda: isinstance(operator.app.focused, Input), "the cursor")
        yield operator, page, form


async def create_finisher(operator: Operator) -> NewPage:
    """Ask for a robot; it is just being made."""
    await operator.until(lambda: bool(operator.app.store.hosts), "a host")
    await operator.press("n")
    page = await operator.at(NewPage)
    await operator.sees("good.py")
    tree = operator.one(SourceTree)
    await operator.until(lambda: tree.has_focus, "the files")
    await operator.press("home")
    await operator.until(lambda: "good.py" in str(tree.cursor_node and tree.cursor_node.label), "the file")
    await operator.press("enter")
    await operator.until(lambda: page.query_one("#name", Input).has_focus, "its name")
    await operator.press("enter")
    await operator.until(lambda: bool(page.carrying), "it is being made")
    return page


async def test_quick_keys_after_create_make_no_other_robots(
    operator: Operator, slow_host: asyncio.Event
) -> None:
    page = await create_finisher(operator)
    operator.burst(f"z{ENTER}w{ENTER}\tne{ENTER}")
    await operator.hears("8 keys (z ⏎ w ⏎ tab n e ⏎)", "finisher is being made")
    await operator.click("#create")
    assert page.query_one("#name", Input).value == "finisher"
    slow_host.set()
    await operator.at(MainPage)
    await operator.until(lambda: "finisher" in operator.app.store.robots, "it is listed")
    assert set(operator.app.store.robots) == {"arm-1", "rover-1", "finisher"}


async def test_a_key_pressed_just_after_the_page_has_closed_is_told(
    operator: Operator, slow_host: asyncio.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    await create_finisher(operator)
    monkeypatch.setattr(key_guard, "LOOK", 60.0)
    slow_host.set()
    await operator.at(MainPage)
    operator.burst("n")
    await operator.hears("the key n was dropped: what is in front now had just come")
    assert isinstance(operator.app.screen, MainPage)


async def test_the_stop_and_the_way_out_work_while_a_robot_is_being_made(
    operator: Operator, slow_host: asyncio.Event
) -> None:
    await create_finisher(operator)
    operator.burst(" ")
    await operator.until(lambda: len(operator.app.store.stopped) == 2, "the stop")
    operator.burst(ESCAPE)
    await operator.at(MainPage)
    await operator.sees("finisher is being made all the same")
    slow_host.set()
    await operator.sees("finisher (Finisher) runs on host-1")


async def test_a_running_command_takes_neither_values_nor_another_run_and_c_cancels_it(
    realm: Realm, operate: Operate
) -> None:
    async with go_to_form(realm, operate) as (operator, page, form):
        realm.arm.under_way = True
        operator.burst(f"{CTRL_U}0.45{CTRL_R}9{CTRL_R}8")
        await operator.until(lambda: form.running, "it runs")
        await operator.hears("3 keys (9 ctrl+r 8) were dropped: go_to is running")
        assert row(form, "x").text == "0.45"
        page.query_one("#commands").focus()
        await operator.press("ctrl+r")
        await operator.hears("go_to is running already")
        realm.arm.under_way = False
        await operator.sees("done in")
        assert realm.arm.calls == ["go_to"]
        realm.arm.under_way = True
        await operator.press("ctrl+r")
        await operator.until(lambda: form.running, "it runs again")
        await operator.press("c")
        await operator.sees("was cancelled")


async def test_hasty_enters_do_not_cancel_what_has_just_begun(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(key_guard, "LOOK", 60.0)
    async with go_to_form(realm, operate) as (operator, _page, form):
        realm.arm.under_way = True
        operator.app.guard.seen = 0.0
        await operator.press("ctrl+r")
        await operator.until(lambda: form.query_one("#cancel", Button).has_focus, "it runs")
        await operator.press("enter")
        await operator.hears("the key ⏎ was dropped: go_to is running")
        assert form.running
        monkeypatch.setattr(key_guard, "LOOK", 0.0)
        await operator.press("enter")
        await operator.sees("was cancelled")
