"""What comes to the front by itself takes no key that was typed before it could be seen."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Input

from robotree.tui.line.grammar import Line
from robotree.tui.screen import key_guard
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.widgets.prompt import Prompt

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

LOOK = 0.5
ESCAPE, ENTER, CTRL_S = "\x1b\x1b", "\r", "\x13"


@pytest.fixture(autouse=True)
def slow(quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for as long as people do."""
    del quick
    monkeypatch.setattr(key_guard, "LOOK", LOOK)


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


async def test_a_text_that_comes_by_itself_takes_no_key_typed_before_it_was_seen(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        page = await described(operator)
        came = operator.app._seen - LOOK
        operator.burst(f"{ENTER}{ESCAPE}", at=came + 0.9 * LOOK)
        operator.burst(ENTER, at=came - 1.0)  # kept waiting by a busy machine
        await dealt_with(operator)
        assert operator.app.screen is page
        operator.burst(ENTER, at=operator.app._seen)
        await operator.at(MainPage)


async def test_a_text_that_comes_while_one_types_waits_for_the_end_of_it(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.press("slash")
        await operator.until(lambda: isinstance(operator.app.focused, Input), "the line")
        page = await described(operator)
        came = operator.app._seen - LOOK
        for step in range(10):
            operator.burst("q n ", at=came + 0.8 * LOOK * step)
        await dealt_with(operator)
        assert operator.app.screen is page
        assert operator.app.store.stopped == (), "a space was a letter"
        assert operator.app._seen > came + 0.8 * LOOK * 10
        operator.burst("q", at=operator.app._seen)
        await operator.at(MainPage)
        assert operator.one(Prompt).letters == ""


@pytest.mark.parametrize("key", [" ", CTRL_S], ids=["space", "ctrl+s"])
async def test_the_stop_waits_for_no_look(realm: Realm, operate: Operate, key: str) -> None:
    async with operate(realm.realm_client) as operator:
        await described(operator)
        operator.burst(key, at=operator.app._seen - LOOK)
        await operator.until(lambda: len(operator.app.store.stopped) == 2, "all are stopped")


async def test_a_dialog_that_a_key_opened_takes_keys_at_once(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.press("question_mark")
        await operator.at(Reading)
        await operator.press("q")
        assert await operator.at(MainPage) is operator.app.main


async def test_the_answer_to_a_question_that_has_closed_is_no_key_of_the_page_beneath(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        await realm.realm_client.stop(None)
        await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
        await operator.press("R")
        await operator.at(Confirm)
        await realm.realm_client.resume(None)
        page = await operator.at(MainPage)
        came = operator.app._seen - LOOK
        operator.burst(f"n{ENTER}", at=came + 0.9 * LOOK)
        await dealt_with(operator)
        assert operator.app.screen is page
