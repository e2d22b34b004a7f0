"""The log keeps its newest line in sight, and leaves alone who reads what is older."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from robotree.tui.screen.widgets.log_pane import LogPane

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


def log_lines(operator: Operator) -> str:
    """Return what the log shows, without the line that flashes below it."""
    log = operator.one(LogPane)
    return "\n".join(log.render_line(y).text for y in range(log.size.height))


@pytest.mark.usefixtures("every_frame")
async def test_the_log_opens_at_its_newest_line_unless_somebody_scrolled_up(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        for number in range(80):
            operator.app.tell(f"event {number}")
        await operator.press("g")
        await operator.sees("event 79")
        await operator.press("l")
        await operator.resize(100, 20)
        for number in range(20):
            operator.app.tell(f"later {number}")
        operator.app.main.draw()
        await operator.press("g")
        await operator.until(lambda: "later 19" in log_lines(operator), "the end")
        await operator.press("home")
        await operator.until(lambda: "event 0" in log_lines(operator), "the beginning")
        operator.app.tell("another one")
        await operator.press("l")
        await operator.resize(100, 24)
        await operator.press("g")
        await operator.until(lambda: "event 3" in log_lines(operator), "what was read")
        await operator.press("end")
        await operator.until(lambda: "another one" in log_lines(operator), "the end")
        operator.app.tell("the last")
        await operator.until(lambda: "the last" in log_lines(operator), "what comes then")
        await operator.press("down")
        operator.app.tell("the next")
        operator.app.progress(0.5, "3 cm to go")  # of a typed command: the list shows it, not the log
        await operator.until(lambda: "the next" in log_lines(operator), "who is at the end follows on")
        assert operator.app.store.entries[-1].text == "the next"


async def test_who_goes_to_the_beginning_while_lines_come_stays_there(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        for number in range(80):
            operator.app.tell(f"event {number}")
        await operator.press("g")
        await operator.sees("event 79")
        operator.app.tell("a line that is still to be scrolled to")
        operator.app.main.draw()
        operator.one(LogPane).action_scroll_home()  # in the same turn
        await operator.until(lambda: "event 0" in log_lines(operator), "the beginning")
        operator.app.tell("the next")
        operator.app.main.draw()
        await operator.settled()
        assert "event 0" in log_lines(operator)


async def test_the_log_is_there_in_a_small_terminal(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, size=(50, 15)) as operator:
        for number in range(30):
            operator.app.tell(f"something happened, and it takes more than one line to say: {number}")
        await operator.press("g")
        await operator.sees("say: 29")
        await operator.resize(80, 24)
        await operator.sees("say: 29")
        await operator.resize(50, 15)
        await operator.sees("say: 29")
