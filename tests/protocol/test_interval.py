"""Rates belong to a connection; a wish that is too fast gets the fastest."""

from __future__ import annotations

import math

import pytest

from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    MavCmd,
    MavResult,
    Message,
    MessageInterval,
    Timesync,
)
from robotree.protocol.services.command import CommandServer
from robotree.protocol.services.interval import FASTEST, Intervals, handlers
from robotree.protocol.services.peer import Peer, Send

JOINTS, TOOL, MODE = 57600, 57601, 57606


@pytest.fixture
def rates() -> Intervals:
    return Intervals({JOINTS: 0.1, TOOL: 0.05, MODE: None})


def _count(rates: Intervals, seconds: float, step: float = 0.001) -> dict[int, int]:
    counts = {JOINTS: 0, TOOL: 0, MODE: 0}
    for i in range(round(seconds / step)):
        for msgid in rates.due(i * step):
            counts[msgid] += 1
    return counts


def test_every_message_has_its_own_rate(rates: Intervals) -> None:
    assert _count(rates, 10.0) == {JOINTS: 100, TOOL: 200, MODE: 0}


@pytest.mark.parametrize("step", [0.003, 0.007, 0.03])
def test_a_coarse_clock_does_not_lower_a_rate(step: float) -> None:
    counts = _count(Intervals({JOINTS: 0.1, TOOL: 0.05, MODE: None}), 30.0, step)
    assert counts[JOINTS] == pytest.approx(300, abs=2)
    assert counts[TOOL] == pytest.approx(600, abs=2)


def test_a_long_sleep_is_not_made_up_for(rates: Intervals) -> None:
    rates.due(0.0)
    assert sorted(rates.due(100.0)) == [JOINTS, TOOL]
    assert rates.due(100.001) == []


@pytest.mark.parametrize(
    ("wish", "interval_us"),
    [
        (20_000, 20_000),
        (-1, -1),
        (0, 100_000),
        (1, round(FASTEST * 1e6)),
        (2e9, 2_000_000_000),
        (1e12, 2**31 - 1),
    ],
)
def test_a_rate_is_set_as_wished_and_told_as_it_is(rates: Intervals, wish: float, interval_us: int) -> None:
    assert rates.set(JOINTS, wish, 0.0)
    assert rates.get(JOINTS) == MessageInterval(JOINTS, interval_us)


@pytest.mark.parametrize(("msgid", "wish"), [(1, 1000.0), (JOINTS, -2.0), (JOINTS, math.inf), (-1, 0.0)])
def test_what_makes_no_sense_changes_nothing(rates: Intervals, msgid: int, wish: float) -> None:
    assert not rates.set(msgid, wish, 0.0)
    assert rates.get(JOINTS) == MessageInterval(JOINTS, 100_000)


def test_the_commands_speak_of_the_link_that_asks() -> None:
    links = {name: Intervals({JOINTS: 0.1}) for name in ("link 1", "link 2")}
    server = CommandServer(
        {},
        handlers(lambda via: links[str(via)], lambda msgid, _: [Timesync(1, 2)] * (msgid == 111)),
    )

    def ask(command: int, *params: float) -> list[Message]:
        padded = (*params, *[math.nan] * (7 - len(params)))
        effects = server.receive(CommandLong(1, 1, command, 0, *padded), Peer("link 1", 255, 190), 0.0)
        assert all(isinstance(each, Send) and each.via == "link 1" for each in effects)
        messages = [each.message for each in effects if isinstance(each, Send)]
        return [each for each in messages if isinstance(each, Message)]

    def result(messages: list[Message]) -> int:
        assert isinstance(messages[0], CommandAck)
        return messages[0].result

    assert result(ask(MavCmd.SET_MESSAGE_INTERVAL, JOINTS, 20_000)) == MavResult.ACCEPTED
    assert result(ask(MavCmd.SET_MESSAGE_INTERVAL, 1, 20_000)) == MavResult.DENIED
    assert ask(MavCmd.GET_MESSAGE_INTERVAL, JOINTS)[1:] == [MessageInterval(JOINTS, 20_000)]
    assert result(ask(MavCmd.GET_MESSAGE_INTERVAL, 1)) == MavResult.DENIED
    assert links["link 2"].get(JOINTS) == MessageInterval(JOINTS, 100_000)
    assert ask(MavCmd.REQUEST_MESSAGE, 111)[1:] == [Timesync(1, 2)]
    assert result(ask(MavCmd.REQUEST_MESSAGE, 7)) == MavResult.DENIED
    assert result(ask(MavCmd.REQUEST_MESSAGE)) == MavResult.DENIED


def test_what_is_sent_at_one_rate_only_is_told_and_never_changed() -> None:
    rates = Intervals({JOINTS: 0.1}, fixed={MODE: 0.5})
    assert rates.get(MODE) == MessageInterval(MODE, 500_000)
    assert not rates.set(MODE, 20_000, 0.0)
    assert rates.due(0.0) == [JOINTS]
    assert rates.due(0.05) == []
    assert rates.due(0.1) == [JOINTS]
