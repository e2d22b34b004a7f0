"""Each safeguard and each lock is needed: without it a known seed breaks a law, or a test elsewhere fails.

`python bench/world.py safeguards` finds the seeds anew after a change of the stories.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from pathlib import Path

import pytest

from tests.command_line import ran
from tests.world.families import FAMILIES
from tests.world.safeguards import SAFEGUARDS, VARIABLE, without
from tests.world.story import Laws

ROOT = Path(__file__).resolve().parents[2]
CAUGHT = {
    "a parent counts a lease from when it asked for it": ("realm", 0),
    "a controller stops when its commander is not heard": ("realm", 0),
    "a child refuses a call under another lease than the one in force": ("realm", 1),
    "a controller refuses an epoch older than one that it obeyed": ("realm", 2),
    "a controller carries a goal out once": ("realm", 2),
    "a release names the stop that it ends": ("realm", 1),
    "a call ends with the program that asked for it": ("realm", 5),
    "a child's command ends by the deadline of its parent's": ("realm", 10),
    "a release ends the stops that were known when it was asked for": ("realm", 24),
    "a call that comes twice is carried out once": ("realm", 2),
    "a robot says that it takes an order before it begins": ("orders", 14),
    "an order that may have begun does not begin again": ("orders", 1),
    "a stop holds a robot that is away": ("orders", 0),
    "the first answer to a question counts": ("groups", 3),
    "a question that was put before a crash waits after it": ("groups", 3),
    "what a script was told it knows after a crash": ("groups", 3),
    "what one of a group refuses is not the others' matter": ("groups", 3),
    "a stop also names who of a group does not answer": ("groups", 4),
    "a request tells another machine its age": ("sites", 10),
    "a stop names each site that it has not reached": ("sites", 0),
    "a robot of the same name at another site is another robot": ("sites", 0),
    "a name is unique at its site and not beyond": ("sites", 0),
    "a request needs the right that the policy gives": ("rights", 0),
    "a command ends when its asker may not have it any more": ("rights", 0),
    "a revocation is handed on to all sites": ("rights", 0),
    "a robot moves for its operator alone": ("hands", 0),
    "an attended command ends without a key": ("hands", 0),
    "the end of a connection is seen though it comes with data": ("mesh", 0),
    "a process whose files are gone registers again": ("mesh", 6),
    "a process that hangs counts as silent": ("mesh", 37),
    "a process that has slept blames nobody": ("mesh", 37),
    "a process that wakes says so": ("mesh", 37),
    "messages on a refused connection do not count": ("mesh at statements", 136),
    "of two that dial each other one gives way": ("mesh", 0),
    "what was asked of a process that is gone ends": ("mesh", 10),
    "a process that has joined knows all who are there": ("mesh", 10),
    "descriptors are kept in reserve": ("host", 0),
    "a reader that leaves is counted out at once": ("threads of readers", 74),
    "a record counts if it fits its checksum": ("disk", 1),
    "a record that was cut short is left out": ("disk", 33),
    "a loss of power may tear what was not synced": ("disk", 38),
    "the names of the files of a log are synced": ("disk", 17),
    "older files of a log stay until the newest is whole": ("disk", 182),
    "what adds up is synced before it is asked for": ("disk", 0),
    "that a robot was deleted is written down": ("disk", 34),
    "a child waits for a parent that is away": ("disk", 6),
    "the next process of a parent that is away is its heir": ("disk", 6),
    "what a process asked before its end keeps no heir away": ("disk", 192),
    "who has called waits for a robot that comes back": ("disk", 4),
    "calls wait until all robots of a host are back": ("disk", 23),
    "the name of a robot that comes back is given to nobody else": ("disk", 2874),
    "nobody waits for a child that an ended process has asked": ("disk", 40),
    "a source in doubt never acts": ("moves", 1),
    "that a robot may be out is written before it is sent": ("moves", 4),
    "a robot that has come is written before that is said": ("moves", 13),
    "what a journal was told": ("threads of journal", 0),
    "the file of a journal": ("threads of journal", 1),
    "the syncs of a journal": ("threads of syncs", 16),
    "calls that wait for a host": ("threads of calls that wait", 8),
    "the queues of a connection": ("mesh", 51),
    "the peers of a mesh": ("threads of mesh", 203),
    "the one who reads": ("mesh", 0),
    "the number of readers": ("threads of readers", 223),
    "the state of a robot": ("threads of robot", 0),
    "the table of presence": ("threads of presence", 7),
    "refusals": ("threads of refusals", 3),
    "the log of a robot": ("threads of log", 0),
    "the work of a serial worker": ("threads of serial worker", 188),
    "the timers of a process": ("threads of timers", 38),
    "interruptions of a worker": ("threads of worker", 14),
    "the callers of a robot": ("threads of callers", 2),
    "the files of a process": ("threads of rendezvous", 0),
}
"""The family and the seed of a story that breaks a law without a safeguard or a lock."""
ELSEWHERE = {
    "a site that is silent begins nothing new": "vr/sites/test_gateway.py",
    "a host that has not taken a robot never does": "machines/test_transfer_machine.py",
    "what is not written does not leave a host": "vr/journal/test_host_journal.py",
    "a log that takes nothing more is removed": "vr/journal/test_host_journal.py",
    "a host whose log can neither be written nor removed ends": "vr/journal/test_host_journal.py",
    "moments that were kept are moved to the present clock": "vr/journal/test_host_journal.py",
    "each life of a host counts its calls anew": "vr/core/test_effects_after_the_journal.py",
    "one host writes a log": "vr/journal/test_log_places.py",
    "a call's number is given back when its result is kept": "vr/journal/test_host_journal.py",
    "a page that takes another step than before is ended": "vr/journal/test_steps_taken_again.py",
    "a child that was begun once is not begun by another life of it": "vr/journal/test_steps_taken_again.py",
    "a restored robot begins again what its process left, and nothing else": (
        "vr/core/test_effects_after_the_journal.py"
    ),
    "a proxy refuses an epoch older than one that it obeyed": "proxy/test_changed_controller.py",
    "a controller obeys the holder of its claim only": "machines/test_claim_machine.py",
    "a call that its caller has given up is never begun": "machines/test_core_machine.py",
    "a cancel that comes before its call is remembered": "vr/core/test_agent_commands.py",
    "a stopped robot begins nothing": "vr/core/test_stops.py",
    "a child ends a lease that is not renewed": "vr/core/test_bonds.py",
    "a request is void some time after it was asked": "vr/core/test_principals.py",
    "a controller ends a goal whose time is over": "protocol/test_goals.py",
    "a controller refuses what was asked of an earlier life of it": "protocol/test_goals.py",
    "a controller refuses goals of a proxy that does not hold it any more": "protocol/test_control.py",
    "a stop is asked for again until it is confirmed": "proxy/test_desired_mode.py",
    "a list of keys proves that it is whole": "vr/network/test_rendezvous.py",
}
"""Under `tests`: the file in which a test fails without a safeguard for which no seed is known."""


@functools.cache
def broken_with_all(family: str, seed: int) -> list[str]:
    """Return the laws that a seed breaks; several safeguards have the same seed."""
    return FAMILIES[family](seed)[1]


class BrokenLawError(Exception):
    """Ends a story."""


def end_story(self: Laws, law: str) -> None:
    """Note that a law is broken; nobody has to see the rest."""

    def end() -> None:
        raise BrokenLawError(law)

    self.broken.append(law)
    self.world.runner.at(0.0, end)


@pytest.mark.parametrize("safeguard", CAUGHT)
def test_without_a_safeguard_its_seed_breaks_a_law(safeguard: str, monkeypatch: pytest.MonkeyPatch) -> None:
    family, seed = CAUGHT[safeguard]
    assert broken_with_all(family, seed) == []
    monkeypatch.setattr(Laws, "complain", end_story)
    with without(safeguard), contextlib.suppress(BrokenLawError):
        assert FAMILIES[family](seed)[1]


def test_each_safeguard_has_a_seed_or_a_test_elsewhere() -> None:
    assert sorted([*CAUGHT, *ELSEWHERE]) == sorted(SAFEGUARDS)
    assert all((ROOT / "tests" / file).is_file() for file in ELSEWHERE.values())


@pytest.mark.soak
@pytest.mark.timeout(300)
@pytest.mark.parametrize("safeguard", ELSEWHERE)
def test_without_a_safeguard_its_test_fails(safeguard: str) -> None:
    words = ["-q", "-x", "-p", "tests.world.safeguards", "-p", "no:cacheprovider"]
    run = ran(
        [sys.executable, "-m", "pytest", *words, f"tests/{ELSEWHERE[safeguard]}"],
        cwd=ROOT,
        env={**os.environ, VARIABLE: safeguard},
    )
    assert run.returncode == pytest.ExitCode.TESTS_FAILED, run.stdout
