"""A whole realm in virtual time: no seed breaks a law, each repeats exactly, and ten safeguards are needed.

Without one of these ten a known seed breaks a law; the other safeguards have tests elsewhere (`ELSEWHERE`).

`python bench/world.py safeguards` finds the seeds anew after a change of the stories.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.world.safeguards import SAFEGUARDS, without
from tests.world.story import Outcome, play

ROOT = Path(__file__).resolve().parents[2]
CAUGHT = {
    "a parent counts a lease from when it asked for it": 0,
    "a controller stops when its commander is not heard": 0,
    "a child refuses a call under another lease than the one in force": 1,
    "a call that comes twice is carried out once": 1,
    "a controller refuses an epoch older than one that it obeyed": 2,
    "a controller carries a goal out once": 2,
    "a release names the stop that it ends": 3,
    "a call ends with the program that asked for it": 5,
    "a child's command ends by the deadline of its parent's": 10,
    "a release ends the stops that were known when it was asked for": 24,
}
"""The seed that breaks a law without a safeguard."""
ELSEWHERE = {
    "a proxy refuses an epoch older than one that it obeyed": "world/test_rival.py",
    "a controller obeys the holder of its claim only": "machines/test_claim_machine.py",
    "a call that its caller has given up is never begun": "machines/test_core_machine.py",
    "a cancel that comes before its call is remembered": "vr/core/test_agent_commands.py",
    "a stopped robot begins nothing": "vr/core/test_stops.py",
    "a child ends a lease that is not renewed": "vr/core/test_lease.py",
    "a request is void some time after it was asked": "vr/core/test_envelope.py",
    "a controller ends a goal whose time is over": "protocol/test_goals.py",
    "a controller refuses what was asked of an earlier life of it": "protocol/test_goals.py",
    "a controller refuses goals of a proxy that does not hold it any more": "protocol/test_fence.py",
    "a stop is asked for again until it is confirmed": "proxy/test_desired_mode.py",
}
"""Under `tests`: the file in which a test fails without a safeguard for which no seed is known."""
DIGEST = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from tests.world.story import play
print(play(1).digest)
"""


@cache
def played(seed: int) -> Outcome:
    return play(seed)


@pytest.mark.parametrize("seed", [0, 2, 21, 186])
def test_a_seed_gives_one_trace(seed: int) -> None:
    """In 186 two commands wait for a child that is lost: they end in the order in which they called it."""
    assert play(seed).digest == played(seed).digest
    assert played(seed).broken == []


def test_a_seed_gives_the_same_trace_in_another_process(tmp_path: Path) -> None:
    """Whatever the order of sets of strings is there, and the folder in which it runs."""

    def digest(seed_of_hashes: str) -> str:
        run = subprocess.run(
            [sys.executable, "-c", DIGEST],
            cwd=tmp_path,
            env={**os.environ, "PYTHONHASHSEED": seed_of_hashes},
            capture_output=True,
            text=True,
            check=True,
        )
        return run.stdout.strip()

    assert digest("1") == digest("2") == played(1).digest


@pytest.mark.parametrize("seed", [1, 2])
def test_robots_that_go_on_from_their_encoded_states_do_the_same(seed: int) -> None:
    """At two hundred moments every robot of the realm goes on from what is decoded from its encoding."""
    assert play(seed, reloads=200).digest == played(seed).digest


def test_the_deadline_of_a_call_begins_when_a_paused_program_goes_on() -> None:
    """In 177 an operator's program is paused when it is to call: it calls some seconds later."""
    assert played(177).broken == []


def test_a_cancelled_command_is_not_waited_for_where_nothing_can_interrupt_it() -> None:
    """In 2236 a command is cancelled between two of its steps, where threads would be interrupted."""
    assert played(2236).broken == []


def test_a_cancel_that_a_paused_robot_did_not_confirm_promises_nothing() -> None:
    """With seed 1185 the operator gets NoAnswer, and the call begins when the process continues."""
    assert played(1185).broken == []


@pytest.mark.parametrize("safeguard", CAUGHT)
def test_without_a_safeguard_its_seed_breaks_a_law(safeguard: str) -> None:
    seed = CAUGHT[safeguard]
    assert played(seed).broken == []
    with without(safeguard):
        assert play(seed).broken


def test_at_least_eight_safeguards_are_known_to_be_needed() -> None:
    assert len(CAUGHT) >= 8


def test_each_safeguard_has_a_seed_or_a_test_elsewhere() -> None:
    assert sorted([*CAUGHT, *ELSEWHERE]) == sorted(SAFEGUARDS)
    assert all((ROOT / "tests" / file).is_file() for file in ELSEWHERE.values())


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_no_seed_breaks_a_law() -> None:
    outcomes = [play(seed) for seed in range(500)]
    assert [(one.seed, one.broken) for one in outcomes if one.broken] == []
