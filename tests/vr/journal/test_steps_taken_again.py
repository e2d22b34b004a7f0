"""Steps of a command: what an interrupted one takes again, and what is no step of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.vr.base.errors import Diverged
from robotree.vr.base.requests import Returned
from robotree.vr.core import events as on
from robotree.vr.running.replay import Intent, Replay
from tests.vr.scripts.test_scripts_after_a_crash import Bundle, HostClient, Life

# -- the same steps in their order, and nothing twice ----------------------------------------------


GO = ["arm", "go_to", {"x": 0.3}]
DONE = on.StepResult("call", GO, None, Returned(key="k/1", value=7))


def replay(kept: dict[str, on.StepResult], own: str = "") -> Replay:
    return Replay(kept, own, "ann", "patrol")


def test_a_step_that_was_kept_is_taken_once() -> None:
    kept = {"1": DONE, "2": on.StepResult("sleep", None, 4.5)}
    taken = replay(kept)
    assert taken.take("1", "call", GO, 1) is DONE
    assert not taken.used_up
    step = taken.take("2", "sleep", None, 2)
    assert step is not None
    assert step.value == 4.5
    assert kept == {}
    assert taken.take("3", "sleep", None, 3) is None
    assert taken.used_up


def test_another_step_than_before_ends_the_command_with_both() -> None:
    with pytest.raises(Diverged) as caught:
        replay({"1": DONE}).take("1", "call", ["arm", "go_to", {"x": 0.4}], 1)
    assert {"arm.go_to(x=0.3)", "arm.go_to(x=0.4)"} <= set(caught.value.data.values())
    with pytest.raises(Diverged):
        replay({"1": DONE}).take("1", "sleep", None, 1)


def test_a_call_that_was_under_way_while_later_steps_were_taken_does_not_use_the_steps_up() -> None:
    taken = replay({f"1{on.BEGUN}": on.StepResult("begun", None, ["robot/arm/7", "9/1", 0]), "2": DONE})
    assert taken.take("1", "call", GO, 1) is None
    assert not taken.used_up
    assert taken.intent("1") == Intent("robot/arm/7", "9/1", 0)
    assert taken.intent("1") is None, "another step has nothing of it"
    assert taken.take("2", "call", GO, 2) is DONE
    assert taken.take("3", "call", GO, 3) is None
    assert taken.used_up


def test_the_last_step_of_a_part_is_known_by_its_own_steps_alone() -> None:
    taken = replay({"1/1": DONE, "7": DONE}, own="1/")
    assert taken.take("1/1", "call", GO, 1) is DONE
    assert taken.take("1/2", "call", GO, 2) is None
    assert taken.used_up, "that the command took seven steps says nothing of its part"


def test_what_was_set_before_a_step_that_is_known_is_not_set_again() -> None:
    taken = replay({"1": DONE})
    taken.rewritten["rounds"] = 1
    taken.take("1", "call", GO, 1)
    assert taken.rewritten == {}
    taken.rewritten["rounds"] = 2
    taken.take("2", "call", GO, 2)
    assert taken.rewritten == {"rounds": 2}, "it may have been lost"


def test_a_page_that_ends_without_a_step_that_it_took_is_named_with_it() -> None:
    assert replay({on.END: on.StepResult(on.END, None, 3)}).left_out() is None
    for path in ("2", "1.2"):
        error = replay({path: DONE}).left_out()
        assert error is not None
        assert error.data["step"] == path


def test_the_end_is_raised_where_it_was_raised_before() -> None:
    taken = replay({on.END: on.StepResult(on.END, None, 3)})
    assert [taken.ended_at(on.END, number) for number in (2, 3, 4)] == [False, True, True]
    assert not taken.ended_at(f"1/{on.END}", 9), "that is the end of another part"


def test_a_field_is_a_step_only_where_it_was_one() -> None:
    taken = replay({"2": on.StepResult("field", ["speed", 1], 0.5)})
    assert taken.has("2", "field", ["speed", 1])
    assert not taken.has("2", "field", ["speed", 2])
    assert not taken.has("1", "field", ["speed", 1])


# -- what the host reads of a robot while its command runs -----------------------------------------


MOODY = '''
import threading

from robotree.vr import Child, VirtualRobot, command, state

class Moody(VirtualRobot):
    """Publishes its mood among its attributes."""

    mood: str = state("calm")
    read = threading.Event()

    @property
    def attributes(self) -> dict[str, str]:
        """Free pairs, and its mood."""
        mood = self.mood
        if mood == "bright":
            self.read.set()
        return {"mood": mood}

    @attributes.setter
    def attributes(self, given: dict[str, str]) -> None:
        pass

    @command
    def cheer(self) -> None:
        """Be bright, until the host has read that."""
        self.mood = "bright"
        print("it is said, too")
        while not self.read.is_set():
            self.sleep(0.005)

class Friend(VirtualRobot):
    """Has one that is moody."""

    other = Child("Moody")

    @command
    def visit(self) -> None:
        """Cheer the other one."""
        self.other.cheer()
'''


async def test_a_host_that_reads_attributes_during_a_command_is_no_thread_of_it(tmp_path: Path) -> None:
    async with Life(tmp_path) as life:
        hosts = HostClient(life.operator, life.host.address)
        await hosts.create(Bundle(MOODY, "moody.py", "Moody"), "moody")
        await hosts.create(Bundle(MOODY, "moody.py", "Friend"), "friend")
        await life.client("friend").enslave("other", life.host.agents["moody"].address)
        begins = life.journal.size
        await life.call("friend", "visit")
        records = life.journal.file.read_bytes()[begins:]
    assert b"bright" in records, "the log holds what it keeps"
    assert b"thread" not in records, "a command with steps of other threads is in doubt after a crash"
