"""Keys that come faster than they are handled do what they do when they come slowly, or are dropped and told.

The bytes are those of a terminal, given to the app at once: nobody waits between two keys.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button, Input

from robotree.tui.line.grammar import Line
from robotree.tui.screen import key_guard
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.field_row import FieldRow
from robotree.tui.screen.widgets.prompt import Prompt
from robotree.tui.screen.widgets.robot_table import RobotTable

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


TAB, BACK_TAB, ENTER, BACKSPACE, CTRL_R, CTRL_U, CTRL_S = "\t", "\x1b[Z", "\r", "\x7f", "\x12", "\x15", "\x13"
LEFT, RIGHT, DOWN, HOME, TOP, DELETE = "\x1b[D", "\x1b[C", "\x1b[B", "\x1b[H", "\x1b[1;5H", "\x1b[3~"


async def listed(operator: Operator, *names: str) -> None:
    """Wait until robots are in the list, and described."""
    wanted = {"arm-1", "rover-1", *names}
    await operator.until(lambda: wanted <= operator.app.store.descriptions.keys(), "their descriptions")
    await operator.until(lambda: operator.one(RobotTable).row_count == len(wanted), "the list")


@asynccontextmanager
async def at_x(realm: Realm, operate: Operate) -> AsyncIterator[tuple[Operator, PanelPage]]:
    """Open the panel of the arm; the cursor is in field x of go_to."""
    async with operate(realm.realm_client) as operator:
        page = await operator.panel()
        page.query(FieldRow).first().focus_entry()
        await operator.until(lambda: isinstance(operator.app.focused, Input), "the cursor")
        yield operator, page


def texts(page: PanelPage) -> list[str]:
    return [entry.value for entry in page.query(Input)]


TYPED = (
    (f"{CTRL_U}0.3{BACKSPACE}4", ["0.4"]),
    (f"{CTRL_U}0.4{TAB}{CTRL_U}0.1{TAB}{CTRL_U}0.3{BACK_TAB}{CTRL_U}-0.2", ["0.4", "-0.2", "0.3"]),
    (f"{CTRL_U}0.4{ENTER}{CTRL_U}0.1{ENTER}{CTRL_U}0.3{ENTER}1", ["0.4", "0.1", "0.3", "1"]),
    (f"{CTRL_U}35{HOME}0.{RIGHT}{RIGHT}{BACKSPACE}9{LEFT}{DELETE}8 m", ["0.38 m"]),
    (f"{CTRL_U}{'1' * 20}{BACKSPACE * 20}0.4{(BACKSPACE + '5') * 20}", ["0.5"]),
)
"""Keys from field x on, and what the fields hold then."""


async def test_a_field_holds_what_was_typed_and_a_click_does_not_come_before_the_last_digit(
    realm: Realm, operate: Operate
) -> None:
    async with at_x(realm, operate) as (operator, page):
        x = page.query(Input).first()
        for keys, fields in TYPED:
            x.focus()
            await operator.until(lambda: x.has_focus, "the cursor")
            operator.burst(keys)
            await operator.until(lambda fields=fields: texts(page)[: len(fields)] == fields, str(fields))
        button = page.query_one("#run", Button).region
        at = f"{button.x + 4};{button.y + 1}"  # a terminal counts from one
        operator.burst(f"{CTRL_U}0.3{BACKSPACE}4\x1b[<0;{at}M\x1b[<0;{at}m")
        await operator.sees("done in")
        assert realm.arm.pose["x"] == 0.4


async def test_list_panel_and_form_follow_one_burst(operator: Operator) -> None:
    await listed(operator)
    operator.burst(f"{TOP}{ENTER}{ENTER}{CTRL_U}0.3{BACKSPACE}4{TAB}{CTRL_U}0.1")
    page = await operator.at(PanelPage)
    await operator.until(lambda: texts(page)[:2] == ["0.4", "0.1"], "both fields")


async def test_a_verb_is_obeyed_as_it_was_typed_and_the_keys_after_it_are_keys(
    realm: Realm, operator: Operator
) -> None:
    await listed(operator)
    operator.burst(f":call arm-1.go_to x=0.3{BACKSPACE}5 y=0 z=0.3 twist=0{ENTER}g:tre{TAB}{BACKSPACE}x")
    await operator.until(lambda: operator.one(Input, "#line").value == "trex", "what was typed last")
    await operator.until(lambda: realm.arm.pose["x"] == 0.5, "the arm is there")
    assert operator.app.main.pane == "log"
    assert operator.app.store.stopped == (), "a space that is typed at the prompt stops nobody"


async def test_a_filter_has_the_letters_that_were_left_over(operator: Operator) -> None:
    await listed(operator)
    operator.burst(f"/arx{BACKSPACE * 2}{CTRL_U}rovee{BACKSPACE}r{ENTER}")
    await operator.until(lambda: operator.one(Prompt).letters == "rover", "the filter")
    operator.burst(f"/{BACKSPACE * 5}arm{ENTER}v")
    await operator.until(lambda: operator.app.main.pane == "views", "the views")
    assert not operator.one(Prompt).letters, "each pane has a filter of its own"
    operator.burst("l")
    await operator.until(lambda: operator.app.main.pane == "robots", "the robots")
    assert operator.one(Prompt).letters == "arm"


async def test_a_dialog_is_answered_by_the_keys_that_came_after_its_own(
    realm: Realm, operator: Operator
) -> None:
    await realm.create("move_to.py", "mover")
    await listed(operator, "mover")
    operator.burst(f"{TOP}{DOWN}d{ENTER}:d{BACKSPACE}show mover{ENTER}")
    await operator.at(Reading)
    assert "mover" in operator.app.store.robots, "Enter came upon Cancel"
    operator.burst(f"q{TOP}{DOWN}d{RIGHT}{ENTER}/m{BACKSPACE}r")
    await operator.until(lambda: "mover" not in operator.app.store.robots, "it is deleted")
    await operator.until(lambda: operator.one(Prompt).letters == "r", "the filter")


async def test_the_stop_overtakes_every_key(realm: Realm, operate: Operate) -> None:
    async with at_x(realm, operate) as (operator, page):
        asked: list[int] = []
        operator.app.ask_for = lambda *_: asked.append(len(operator.app._held))  # type: ignore[method-assign]
        operator.burst(f"{'1' * 20} {CTRL_S}")
        await operator.until(lambda: bool(asked), "the stop while one types")
        assert asked[0] > 15, "the keys before it were still to be dealt with"
        await operator.until(lambda: not operator.app._held, "the keys before it")
        page.query_one("#commands").focus()
        await operator.until(lambda: page.query_one("#commands").has_focus, "the list")
        operator.burst(f"{DOWN * 20} ")
        await operator.until(lambda: len(asked) > 1, "the stop")
        assert asked[1] > 15
        await operator.until(lambda: operator.app._under_way is None, "the rest")  # nobody leaves amid keys


async def test_a_flood_of_keys_is_bounded_and_the_stop_is_obeyed_in_it(
    operator: Operator, caplog: pytest.LogCaptureFixture
) -> None:
    await listed(operator)
    app, asked = operator.app, list[int]()
    ask_for = app.ask_for
    app.ask_for = lambda *_: asked.append(len(app._held))  # type: ignore[method-assign]
    operator.burst("\0" * 2000)
    operator.burst(" " * 1000)
    await operator.until(lambda: bool(asked), "the stop")
    assert len(app._held) <= key_guard.MOST
    await operator.until(lambda: not app.keys_wait, "the rest")
    assert len(asked) <= key_guard.MOST
    assert caplog.text.count("are dropped until") == 1
    app.ask_for = ask_for  # type: ignore[method-assign]
    operator.burst(f":\x1b[200~{'paste' * 2000}\x1b[201~")
    await operator.until(lambda: len(operator.one(Input, "#line").value) == 10_000, "the paste")
    operator.burst("x")
    await operator.until(lambda: len(operator.one(Input, "#line").value) == 10_001, "a key after it")


async def test_a_queue_that_ended_with_a_key_in_it_does_not_keep_the_others(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(key_guard, "LIMIT", 0.05)
    async with operate(realm.realm_client) as operator:
        await listed(operator)
        table = operator.one(RobotTable)

        def lose(what: Callable[..., object], *_: object) -> bool:
            return what.__name__ == "_pass"  # it takes it, and nothing comes of it

        monkeypatch.setattr(table, "call_later", lose)
        operator.burst("gv")
        await operator.until(lambda: operator.app.main.pane == "views", "the second key")


SIGHT = 0.5
ESCAPE = "\x1b\x1b"


@pytest.fixture
def slow(quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for as long as people do."""
    del quick
    monkeypatch.setattr(key_guard, "LOOK", SIGHT)


async def described(operator: Operator) -> Reading:
    """Have a longer text come up, as when a verb returns after a while."""
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "its description")
    operator.app.perform(Line("show", {"NAME": "arm-1"}))
    return await operator.at(Reading)


async def dealt_with(operator: Operator) -> None:
    """Wait until all keys have arrived and been taken."""
    arrived = asyncio.Event()
    operator.app.call_later(arrived.set)
    await arrived.wait()
    await operator.until(lambda: operator.app._under_way is None and not operator.app._held, "the keys")


@pytest.mark.usefixtures("slow")
async def test_a_text_that_comes_by_itself_takes_no_key_typed_before_it_was_seen(operator: Operator) -> None:
    page = await described(operator)
    came = operator.app.guard.seen - SIGHT
    operator.burst(f"{ENTER}{ESCAPE}", at=came + 0.9 * SIGHT)
    operator.burst(ENTER, at=came - 1.0)  # kept waiting by a busy machine
    await dealt_with(operator)
    assert operator.app.screen is page
    operator.burst(ENTER, at=operator.app.guard.seen)
    await operator.at(MainPage)


@pytest.mark.usefixtures("slow")
async def test_a_text_that_comes_while_one_types_waits_for_the_end_of_it(operator: Operator) -> None:
    await operator.press("slash")
    await operator.until(lambda: isinstance(operator.app.focused, Input), "the line")
    page = await described(operator)
    came = operator.app.guard.seen - SIGHT
    for step in range(10):
        operator.burst("q n ", at=came + 0.8 * SIGHT * step)
    await dealt_with(operator)
    assert operator.app.screen is page
    assert operator.app.store.stopped == (), "a space was a letter"
    assert operator.app.guard.seen > came + 0.8 * SIGHT * 10
    operator.burst("q", at=operator.app.guard.seen)
    await operator.at(MainPage)
    assert operator.one(Prompt).letters == ""


@pytest.mark.usefixtures("slow")
@pytest.mark.parametrize("key", [" ", CTRL_S], ids=["space", "ctrl+s"])
async def test_the_stop_waits_for_no_look(operator: Operator, key: str) -> None:
    await described(operator)
    operator.burst(key, at=operator.app.guard.seen - SIGHT)
    await operator.until(lambda: len(operator.app.store.stopped) == 2, "all are stopped")


@pytest.mark.usefixtures("slow")
async def test_a_dialog_that_a_key_opened_takes_keys_at_once(operator: Operator) -> None:
    await operator.press("question_mark")
    await operator.at(Reading)
    await operator.press("q")
    assert await operator.at(MainPage) is operator.app.main


@pytest.mark.usefixtures("slow")
async def test_the_answer_to_a_question_that_has_closed_is_no_key_of_the_page_beneath(
    realm: Realm, operator: Operator
) -> None:
    await realm.realm_client.stop(None)
    await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
    await operator.press("R")
    await operator.at(Confirm)
    await realm.realm_client.resume(None)
    page = await operator.at(MainPage)
    came = operator.app.guard.seen - SIGHT
    operator.burst(f"n{ENTER}", at=came + 0.9 * SIGHT)
    await dealt_with(operator)
    assert operator.app.screen is page
