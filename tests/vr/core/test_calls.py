from __future__ import annotations

import pytest

from robotree.vr.calls import CallTable
from robotree.vr.errors import CommandCancelled, KeyReused

MOVE = ("move", {"x": 1.0})


def test_the_same_call_finds_its_job_running_or_ended() -> None:
    table: CallTable[str] = CallTable("rover")
    assert table.find("k/1", MOVE) is None
    table.enter("k/1", MOVE, "job")
    assert table.find("k/1", ("move", {"x": 1.0})) == "job"
    table.end("k/1")
    assert table.find("k/1", MOVE) == "job"


@pytest.mark.parametrize("other", [("move", {"x": 2.0}), ("stop", {"x": 1.0}), ("move", {})])
def test_a_key_is_for_one_call(other: tuple[str, dict[str, float]]) -> None:
    table: CallTable[str] = CallTable("rover")
    table.enter("k", MOVE, "job")
    with pytest.raises(KeyReused, match="rover has seen the key 'k' with another call of move"):
        table.find("k", other)


def test_the_oldest_results_are_forgotten_but_nothing_that_runs() -> None:
    table: CallTable[str] = CallTable("rover", limit=2)
    table.enter("runs", MOVE, "running")
    for number in range(10):
        table.enter(str(number), MOVE, str(number))
        table.end(str(number))
    assert len(table) == 3
    assert table.find("runs", MOVE) == "running"
    assert table.find("7", MOVE) is None
    assert table.find("8", MOVE) == "8"


def test_a_cancel_that_overtakes_its_call_wins() -> None:
    table: CallTable[str] = CallTable("rover", limit=2)
    table.bury("k", "the caller gave up")
    with pytest.raises(CommandCancelled, match=r"rover.move was cancelled: the caller gave up"):
        table.find("k", MOVE)
    table.bury("l", "")
    table.bury("m", "")
    assert table.find("k", MOVE) is None  # bounded, too


def test_a_cancel_of_what_has_ended_changes_nothing() -> None:
    table: CallTable[str] = CallTable("rover")
    table.enter("k", MOVE, "job")
    table.end("k")
    table.bury("k", "late")
    assert table.find("k", MOVE) == "job"
