"""A limit for one call of a child, and one line for all children of a group."""

from __future__ import annotations

import pytest

from robotree.kinds import Arm, Rover
from robotree.testing import Fake, Page, rehearse
from robotree.vr import Child, Children, ChildTimeout, CommandFailed, VirtualRobot, command


class Hasty(VirtualRobot):
    """Gives its arm little time."""

    arm = Child("Arm")

    @command
    def go(self, limit: str) -> str:
        """Go, and say what came of it."""
        try:
            self.arm.go_to(x=0.3, y=0, z=0.3, twist=0, within=limit)
        except ChildTimeout as error:
            return str(error)
        return "done"

    @command
    def race(self) -> None:
        """Go beside the block."""
        with self.together() as both:
            both.start(self.arm.go_to, x=0.3, y=0, z=0.3, twist=0, within="500 ms")


class Patient(VirtualRobot):
    """Gives its arm all the time that it has itself."""

    arm = Child(Arm)

    @command
    def go(self) -> None:
        """Go, without a limit."""
        self.arm.go_to(x=0.3, y=0, z=0.3, twist=0, within=None)
        self.arm.grip.start(action="open", within=None).result()


class Impatient(VirtualRobot):
    """Waits a second for its arm, does something else, and looks again."""

    arm = Child(Arm)

    @command
    def go(self) -> bool:
        """Return whether the arm was still on its way a second after the waiting had ended."""
        going = self.arm.go_to.start(x=0.3, y=0, z=0.3, twist=0)
        try:
            going.result(1)
        except TimeoutError:
            self.sleep(1)
            return not going.done
        return False


class Slow(VirtualRobot):
    """A page that takes its time."""

    @command
    def work(self) -> None:
        """Take long."""
        self.sleep(30)


class Above(VirtualRobot):
    """A page above a page."""

    slow = Child("Slow")

    @command
    def go(self) -> None:
        """Give it a second."""
        self.slow.work(within=1)


class RealmClient(VirtualRobot):
    """Rovers that move together."""

    rovers = Children("Rover", least=0)

    @command
    def advance(self) -> int:
        """Move all."""
        return len(self.rovers.move(x=0.2, y=0))


def test_a_call_within_its_limit_is_done() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=1.0))
    assert team.call("go", limit="2 s") == "done"


def test_a_call_that_is_late_is_cancelled_and_named_with_its_limit() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=10.0))
    before = team.now
    said = team.call("go", limit="2 s")
    assert said.startswith("arm.go_to was not done within the 2 s that its caller gave it, and was cancelled")
    assert team.now - before == pytest.approx(2.0, abs=0.1)
    team.wait(0.5)
    assert not team.describe("arm").busy


def test_a_result_that_was_waited_for_too_long_leaves_the_child_at_work_until_the_command_ends() -> None:
    team = rehearse(Impatient, arm=Fake(Arm, takes=30.0))
    before = team.now
    assert team.call("go") is True
    assert team.now - before == pytest.approx(2.0, abs=0.2)
    team.wait(0.5)
    assert not team.describe("arm").busy, "what a command has started ends with it"


def test_none_is_no_limit() -> None:
    team = rehearse(Patient, arm=Fake(Arm, takes=30.0))
    team.call("go", within=100)
    assert team.commanded == [
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.3, "twist": 0}),
        ("arm", "grip", {"action": "open"}),
    ]


def test_a_page_below_is_cancelled_too() -> None:
    team = rehearse(Above, slow=Page(Slow))
    with pytest.raises(ChildTimeout, match=r"slow\.work was not done within the 1 s"):
        team.call("go")
    team.wait(0.5)
    assert not team.describe("slow").busy


def test_a_child_that_hangs_keeps_its_parent_no_longer_than_the_limit() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=10.0).freeze("go_to", lasts=1.8))
    before = team.now
    assert "within the 1 s" in team.call("go", limit="1 s")
    assert team.now - before == pytest.approx(1.0, abs=0.1)


def test_a_part_of_a_block_that_is_late_fails_the_block() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=10.0))
    with pytest.raises(ChildTimeout, match="within the 500 ms"):
        team.call("race")


def test_a_limit_that_is_no_time_is_refused_with_the_line() -> None:
    team = rehearse(Hasty, arm=Fake(Arm))
    with pytest.raises(Exception, match=r"arm\.go_to: within: .*test_limits_and_groups\.py, line"):
        team.call("go", limit="2 kg")


def test_all_of_a_group_move_at_the_same_time() -> None:
    team = rehearse(RealmClient, rovers=[Fake(Rover, takes=1.0), Fake(Rover, takes=1.0)])
    before = team.now
    assert team.call("advance") == 2
    assert team.now - before < 1.5


def test_the_first_of_a_group_that_fails_cancels_the_others() -> None:
    team = rehearse(RealmClient, rovers=[Fake(Rover, takes=20.0), Fake(Rover).refuse("move", why="stuck")])
    before = team.now
    with pytest.raises(CommandFailed, match="stuck"):
        team.call("advance")
    assert team.now - before < 5
