"""Operators who hand robots over, and hold keys, in virtual time: no seed breaks a law."""

from __future__ import annotations

import pytest

from tests.world.hands import play

SEEDS = range(2)


def test_no_seed_breaks_a_law_and_each_gives_one_trace(caplog: pytest.LogCaptureFixture) -> None:
    played = [play(seed) for seed in SEEDS]
    assert [judge.broken for _, judge in played] == [[] for _ in SEEDS]
    assert all(judge.steps > 50 and judge.told > 5 and judge.tickets for _, judge in played)
    assert play(0)[0] == played[0][0]
    errors = {record.getMessage() for record in caplog.records if record.levelname == "ERROR"}
    assert not errors, "a robot whose command a person has asked for publishes its state"
