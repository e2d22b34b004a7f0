"""`@retry`: what has surely failed is tried again, with new keys; an end or a doubt never is."""

from __future__ import annotations

import pytest

from robotree.kinds import Arm
from robotree.testing import Fake, in_turn, rehearse
from robotree.testing.team import Team
from robotree.vr import (
    BadArgument,
    Child,
    ChildCancelled,
    ChildTimeout,
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    Failed,
    SlotEmpty,
    VirtualRobot,
    VrError,
    command,
    retry,
)
from robotree.vr.base.errors import Busy, NoAnswer, Stopped


class Slipped(Exception):
    """A class of the page's own."""


class Stubborn(VirtualRobot):
    """Tries again."""

    arm = Child("Arm")

    @retry(times=3, backoff="1 s")
    def close(self) -> None:
        """Close the gripper."""
        self.arm.grip(action="close")

    @command
    def grip(self) -> None:
        """Close the gripper."""
        self.close()

    @command
    @retry(times=2)
    def go(self, limit: float) -> None:
        """Go within a limit."""
        self.arm.go_to(x=0.3, y=0, z=0.3, twist=0, within=limit)

    @command
    @retry(times=5)
    def disguise(self) -> None:
        """Raise an error of its own."""
        try:
            self.arm.grip(action="close")
        except VrError as error:
            raise Slipped("it slipped") from error

    @command
    @retry(times=5)
    def mistake(self) -> None:
        """Make a mistake after a call."""
        self.arm.grip(action="close")
        raise ValueError("a mistake")


def stubborn(*results: object) -> Team:
    return rehearse(Stubborn, arm=Fake(Arm, takes=0.1, grip=in_turn(*results)))


def attempts(team: Team) -> int:
    return len(team.commanded)


def test_each_repetition_is_a_new_call_with_a_new_key() -> None:
    team = stubborn(Failed("slipped"), Slipped("again"), None)
    team.call("grip")
    calls = [step for step in team.steps if step.command == "grip" and step.robot]
    assert len({step.key for step in calls}) == attempts(team) == 3
    first, second, third = (step.at for step in calls)
    assert second - first == pytest.approx(1.1, abs=0.05)
    assert third - second == pytest.approx(2.1, abs=0.05)


def test_the_last_failure_is_raised() -> None:
    team = stubborn(Failed("one"), Failed("two"), Failed("three"), None)
    with pytest.raises(Failed, match="three"):
        team.call("grip")
    assert attempts(team) == 3


def test_a_robot_whose_queue_is_full_is_asked_again() -> None:
    team = stubborn(Busy(robot="arm", waiting=9, how="wait"), None)
    team.call("grip")
    assert attempts(team) == 2


@pytest.mark.parametrize(
    "error",
    [
        CommandInDoubt("it may hold it"),
        DeadlineExceeded(),
        CommandCancelled("somebody"),
        Stopped(robot="arm", reason="x", commander="arm"),
        BadArgument("action", "is none"),
        NoAnswer(key="robot/arm/1", seconds=5.0),
        SlotEmpty(robot="x", slot="arm", reason="lost", kind="Arm"),
    ],
)
@pytest.mark.parametrize("name", ["grip", "disguise"])
def test_an_end_or_a_doubt_is_never_repeated(name: str, error: VrError) -> None:
    team = stubborn(error, None)
    with pytest.raises(VrError):
        team.call(name)
    assert attempts(team) == 1


def test_an_error_of_the_pages_own_is_repeated() -> None:
    team = stubborn(Failed("one"), None)
    team.call("disguise")
    assert attempts(team) == 2


def test_a_mistake_of_the_page_is_not_repeated() -> None:
    team = stubborn(None)
    with pytest.raises(CommandFailed, match="a mistake"):
        team.call("mistake")
    assert attempts(team) == 1


def test_the_limit_of_a_call_is_not_repeated() -> None:
    team = rehearse(Stubborn, arm=Fake(Arm, takes=9.0))
    with pytest.raises(ChildTimeout):
        team.call("go", limit=0.5)
    assert attempts(team) == 1


@pytest.mark.parametrize("what", ["cancel", "stop"])
@pytest.mark.parametrize("after", [0.05, 0.5])
def test_a_cancel_or_a_stop_ends_the_call_and_the_wait(what: str, after: float) -> None:
    team = stubborn(Failed("one"), None)
    going = team.start("grip")
    team.wait(after)
    getattr(team, what)()
    with pytest.raises(CommandCancelled):
        going.result()
    team.wait(10.0)
    assert attempts(team) == 1


def test_the_deadline_ends_the_wait() -> None:
    team = stubborn(Failed("one"), None)
    with pytest.raises(DeadlineExceeded):
        team.call("grip", within=0.5)
    assert attempts(team) == 1


def test_a_child_that_is_cancelled_alone_or_lost_is_not_asked_again() -> None:
    team = rehearse(Stubborn, arm=Fake(Arm, takes=5.0))
    going = team.start("grip")
    team.wait(1.0)
    team.lose("arm")
    with pytest.raises(SlotEmpty):
        going.result()
    assert attempts(team) == 1
    team = stubborn(CommandCancelled("its operator"), None)
    with pytest.raises(ChildCancelled):
        team.call("grip")
    assert attempts(team) == 1


def test_what_is_written_wrongly_is_refused() -> None:
    with pytest.raises(TypeError, match="give how often"):
        retry(times=0)
    with pytest.raises(ValueError, match="is no time"):
        retry(times=2, backoff=-1)
    with pytest.raises(TypeError, match="write @command above @retry"):
        retry(times=2)(command(lambda_named))


def lambda_named(robot: object) -> None:
    """Do nothing."""
