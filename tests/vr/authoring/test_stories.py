"""What authors do, written as a student would write it; one test for each story that is told nowhere else."""

from __future__ import annotations

from typing import Annotated

import pytest

from robotree.kinds import Arm, Rover
from robotree.testing import Fake, Page, in_turn, rehearse, rehearse_seeds
from robotree.vr import (
    BadArgument,
    Child,
    ChildCancelled,
    Children,
    CommandCancelled,
    Failed,
    Range,
    SlotEmpty,
    Unit,
    VirtualRobot,
    command,
)

Metres = Annotated[float, Unit("m"), Range(0, 1)]


# -- an optional child -----------------------------------------------------------------------------


class Watchful(VirtualRobot):
    """An arm that asks a rover whether the way is free, if there is one."""

    arm = Child("Arm")
    guard = Child("Rover", optional=True)

    @command
    def reach(self) -> str:
        """Go there, and say who looked."""
        seen = "nobody looked"
        if self.guard:
            seen = f"it stands at {self.guard.get_info().x:g}"
        self.arm.go_to(x=0.3, y=0, z=0.3, twist=0)
        return seen


def test_a_robot_works_without_its_optional_child_and_with_it() -> None:
    with rehearse(Watchful, arm=Fake(Arm)) as team:
        assert team.call("reach") == "nobody looked"
        team.fill("guard", Fake(Rover, get_info={"x": 2.0}))
        assert team.call("reach") == "it stands at 2"


# -- a thesis' array -------------------------------------------------------------------------------


class Convoy(VirtualRobot):
    """Rovers that drive one after the other; one that is lost is left behind."""

    rovers = Children("Rover", least=2, most=4)

    @command
    def drive(self, x: Metres) -> list[int]:
        """Drive; tell which arrived."""
        arrived: list[int] = []
        for index, rover in self.rovers.items():
            try:
                rover.move(x=x, y=0)
            except SlotEmpty:
                continue
            arrived.append(index)
        return arrived


def test_a_convoy_goes_on_without_the_rover_that_it_loses() -> None:
    rovers = [Fake(Rover), Fake(Rover).lose("move", after=0.5), Fake(Rover)]
    with rehearse(Convoy, rovers=rovers) as team:
        assert team.call("drive", x="50 cm") == [0, 2]
        assert team.call("drive", x=0.5) == [0, 2]
        team.fill("rovers[1]", Fake(Rover))
        assert team.call("drive", x=0.5) == [0, 1, 2]


def test_a_convoy_keeps_the_laws_whatever_goes_wrong() -> None:
    rehearse_seeds(Convoy, "drive", {"x": 0.5}, rovers=[Fake(Rover), Fake(Rover)], seeds=30)


# -- trying again ----------------------------------------------------------------------------------


class Patient(VirtualRobot):
    """Tries three times, and says how often."""

    arm = Child("Arm")

    @command
    def take(self) -> int:
        """Grip until something is in the hand."""
        for attempt in (1, 2, 3):
            self.progress(attempt / 3, f"attempt {attempt}")
            self.arm.grip(action="close")
            if self.arm.get_info().holding:
                return attempt
            self.arm.grip(action="open")
            self.sleep(60)
        raise Failed("it slips out of the hand", attempts=3)


def test_a_robot_that_waits_a_minute_between_attempts_is_tested_in_a_moment() -> None:
    arm = Fake(Arm, get_info=in_turn({"holding": False}, {"holding": True}))
    with rehearse(Patient, arm=arm) as team:
        assert team.call("take", within=300) == 2
        assert team.now > 60
        assert team.progress == [(1 / 3, "attempt 1"), (2 / 3, "attempt 2")]


def test_a_failure_tells_its_values_to_the_parent() -> None:
    with rehearse(Patient, arm=Fake(Arm)) as team:
        with pytest.raises(Failed) as caught:
            team.call("take", within=300)
        assert caught.value.attempts == 3


def test_a_wait_ends_at_once_when_it_is_cancelled() -> None:
    with rehearse(Patient, arm=Fake(Arm)) as team:
        team.cancel(after=10.0)
        with pytest.raises(CommandCancelled):
            team.call("take", within=300)
        assert team.now < 11


# -- somebody else's cancel ------------------------------------------------------------------------


class Shared(VirtualRobot):
    """Goes on when somebody cancels the arm alone."""

    arm = Child("Arm")

    @command
    def go(self) -> str:
        """Go, and say what happened."""
        try:
            self.arm.go_to(x=0.3, y=0, z=0.3, twist=0)
        except ChildCancelled:
            return "somebody has cancelled the arm"
        return "there"


def test_an_arm_that_fails_by_a_cancel_of_its_own_does_not_end_the_page() -> None:
    cancelled = CommandCancelled(robot="arm", command="go_to", reason="by hand")
    with rehearse(Shared, arm=Fake(Arm, go_to=cancelled)) as team:
        assert team.call("go") == "somebody has cancelled the arm"


class Choosy(VirtualRobot):
    """Refuses, or has the arm refuse."""

    arm = Child("Arm")

    @command
    def take(self, x: float) -> None:
        """Take what is near."""
        if x > 1.0:
            raise BadArgument(command="take", parameter="x", reason="is too far")
        self.arm.go_to(x=x, y=0, z=-9.0, twist=0)


def test_only_what_a_child_refuses_names_the_line_of_the_page() -> None:
    with rehearse(Choosy, arm=Fake(Arm)) as team:
        with pytest.raises(BadArgument) as own:
            team.call("take", x=2.0)
        assert str(own.value).endswith("is too far")
        with pytest.raises(BadArgument, match=r"\(test_stories\.py, line \d+\)$"):
            team.call("take", x=0.3)


# -- pages on pages --------------------------------------------------------------------------------


class Twice(VirtualRobot):
    """Drives a convoy twice, and lets the arm be moved from above."""

    convoy = Child("Convoy")
    arm = Child("Arm")

    @command
    def there_and_back(self, x: Metres) -> int:
        """Drive twice; tell how many arrived in all."""
        return sum(len(self.convoy.drive(x=x)) for _ in range(2))

    grip = arm.exposed()
    where = arm.exposed("get_info")


def test_a_page_commands_a_page_and_lets_a_command_through_under_another_name() -> None:
    convoy = Page(Convoy, rovers=[Fake(Rover), Fake(Rover)])
    with rehearse(Twice, convoy=convoy, arm=Fake(Arm, get_info={"z": 0.2})) as team:
        assert team.call("there_and_back", x="1 m") == 4
        assert team.call("where").z == 0.2
        team.call("grip", action="width", width="3 cm")
        assert team.commanded[-1] == ("arm", "grip", {"action": "width", "width": 0.03})
        with pytest.raises(BadArgument, match="width"):
            team.call("grip", action="width", width="3 kg")
