"""What commands somebody does not pass where nobody shall be commanded."""

from __future__ import annotations

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.dialect.table import by_name
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    Goal,
    GoalCancel,
    GoalStatus,
    Heartbeat,
    ParamRequestList,
    ParamSet,
    Ping,
    SetMode,
)
from robotree.protocol.tools.capture.records import Captured
from robotree.protocol.tools.capture.replay import RecordFilter, commands


def test_a_passive_sieve_lets_pass_what_tells_and_asks_but_nothing_that_commands() -> None:
    tells = [
        Heartbeat(6, 8, 0, 0, 4),
        GoalStatus(7, 9, 0.5, 1, 0, 255, 190, 2),
        Ping(1, 1),
        CommandAck(57601, 0),
        ParamRequestList(1, 1),
    ]
    orders = [
        Goal(7, 9, 0, (0.0,) * 7, 1, 1, 1),
        GoalCancel(7, 9, 1, 1),
        SetMode(9, 1, 1, 1),
        CommandLong(1, 1, 57601, 0, *(0.0,) * 7),
        ParamSet(1, 1, "TOOL_SPEED", 0.1, 9),
    ]
    mixed = [each for both in zip(tells, orders, strict=True) for each in both]
    whole = b"".join(encode(each, sequence=i, system=255, component=190) for i, each in enumerate(mixed))
    filter_ = RecordFilter(passive=True)
    (passed,) = filter_.filter([Captured(whole, 1)])
    assert [one.message for one in Parser().feed(passed.data)] == tells
    assert (filter_.commands.total(), filter_.withheld) == (len(orders), 0)
    assert [one.data for one in RecordFilter().filter([Captured(whole, 1)])] == [whole]


@pytest.mark.parametrize("name", ["MANUAL_CONTROL", "MISSION_ITEM_INT", "SET_POSITION_TARGET_LOCAL_NED"])
def test_what_commands_in_other_peoples_words_is_held_back_in_either_version_of_the_wire(name: str) -> None:
    number = by_name()[name].id
    assert commands(b"\xfd\0\0\0\0\1\1" + number.to_bytes(3, "little") + b"..")
    assert commands(bytes((0xFE, 0, 0, 1, 1, number)) + b"..")
