"""Pages for the tests of the test kit: one that is written well, and some that are not."""

from __future__ import annotations

import contextlib
from typing import Annotated

from robotree import kinds
from robotree.vr import (
    Child,
    Children,
    CommandFailed,
    Kind,
    Range,
    SlotEmpty,
    Unit,
    VirtualRobot,
    VrError,
    command,
    promised,
)

Metres = Annotated[float, Unit("m"), Range(0.0, 0.4), "how far up"]


class Lift(VirtualRobot):
    """Grips what is below the gripper and lifts it."""

    arm = Child("Arm")
    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.25)] = 0.1

    @command
    def lift(self, height: Metres = 0.1) -> Annotated[float, Unit("m")]:
        """Grip, lift, and tell how high it is."""
        here = self.arm.get_info()
        self.progress(0.0, "gripping")
        self.arm.grip(action="close")
        self.progress(0.5, "lifting")
        self.arm.go_to(x=here.x, y=here.y, z=here.z + height, twist=here.twist)
        self.progress(1.0, "lifted")
        return float(self.arm.get_info().z)

    @command
    def rise(self) -> None:
        """Go up at the speed that is set."""
        self.arm.go_to(x=0.3, y=0.0, z=0.4, twist=0.0, speed=self.speed)

    @command
    def go_too_far(self) -> None:
        """Command what the arm refuses."""
        self.arm.go_to(x=5.0, y=0.0, z=0.3, twist=0.0)

    @command
    def stumble(self) -> None:
        """Make a mistake of its own."""
        self.arm.grip(action="open")
        raise KeyError("shelf")

    get_info = arm.exposed()


class Crowd(VirtualRobot):
    """Several arms that do the same."""

    arms = Children("Arm", least=1, most=4)

    @command
    def hold(self) -> int:
        """Have all hold still; tell how many did."""
        held = 0
        for arm in self.arms:
            with contextlib.suppress(SlotEmpty):
                arm.hold()
                held += 1
        return held


class Typed(VirtualRobot):
    """Knows what an arm promises."""

    arm = Child(kinds.Arm)

    @command
    def height(self) -> float:
        """Tell how high the arm is."""
        return self.arm.get_info().z


class Half(Kind):
    """Not all of an arm."""

    @promised(effect="repeat")
    def grip(self) -> None:
        """Close."""
        raise NotImplementedError


Half.__name__ = "Arm"


class Sending(VirtualRobot):
    """Sends an arm off and does not wait."""

    arm = Child("Arm")

    @command
    def send(self) -> None:
        """Send it."""
        self.arm.go_to.tell(x=0.3, y=0.0, z=0.3, twist=0.0)


class Hidden(VirtualRobot):
    """Lets through what nobody knows."""

    ghost = Child("Ghost")
    show = ghost.exposed()


class Hoist(VirtualRobot):
    """Lifts twice: a page on top of a page."""

    lift = Child("Lift")

    @command
    def twice(self, height: Metres = 0.1) -> Annotated[float, Unit("m")]:
        """Lift, and lift again."""
        self.lift.lift(height=height)
        return float(self.lift.lift(height=height))


class Careless(VirtualRobot):
    """Makes a mistake as soon as a child fails."""

    arm = Child("Arm")

    @command
    def lift(self) -> None:
        """Look at an error in a way that is wrong."""
        try:
            self.arm.grip(action="close")
            self.arm.go_to(x=0.3, y=0.0, z=0.4, twist=0.0)
        except CommandFailed as error:
            raise RuntimeError(error.no_such_detail) from error  # type: ignore[attr-defined]


class Deaf(VirtualRobot):
    """Goes on whatever happens."""

    arm = Child("Arm")

    @command
    def lift(self) -> None:
        """Try again without end."""
        while True:
            try:
                self.arm.go_to(x=0.3, y=0.0, z=0.4, twist=0.0)
            except VrError:
                self.arm.go_to(x=0.3, y=0.0, z=0.3, twist=0.0)
            else:
                return


class Swallowing(VirtualRobot):
    """Ignores every interruption, and so can never be ended."""

    arm = Child("Arm")

    @command
    def lift(self) -> None:
        """Do not listen."""
        while True:
            try:
                self.sleep(0.5)
                self.arm.go_to(x=0.3, y=0.0, z=0.4, twist=0.0)
            except BaseException:  # noqa: BLE001, S112 # that is its mistake
                continue
            return


class Spinning(VirtualRobot):
    """Asks for a child that is gone, again and again, without a pause."""

    arm = Child("Arm")

    @command
    def lift(self) -> None:
        """Do not pause."""
        while True:
            with contextlib.suppress(VrError):
                self.arm.grip(action="open")
                return
