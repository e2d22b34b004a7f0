"""The refusals of a simulated robot, with their reasons.

::

    SimError
      GoalRefused           a goal was not begun; `reason` goes over the wire, the message becomes its text
        OutOfReach          no posture reaches the point, or it lies outside the robot's place
        PathBlocked         reachable, but no way leads there from here
        BadArgument         a number is missing, infinite or out of range
      UnknownKind           no robot of that kind can be simulated
      CannotListen          the address is taken; also an OSError
      MemoryLost            which leases were obeyed is not known any more

A GoalRefused is the fault of the goal's sender; the robot has not moved.
"""

from collections.abc import Iterable, Sequence
from typing import ClassVar

from robotree.protocol.links.url import instead
from robotree.protocol.messages import Reason


class SimError(Exception):
    """The root of all errors of this package."""


class GoalRefused(SimError):
    """A goal was not begun."""

    reason: ClassVar[Reason] = Reason.FAULT


class OutOfReach(GoalRefused):
    """The point cannot be reached. Choose another one."""

    reason = Reason.OUT_OF_REACH

    def __init__(self, point: Sequence[float], why: str) -> None:
        self.point, self.why = tuple(point), why
        super().__init__(f"({_metres(point)}) is out of reach: {why}")


class PathBlocked(GoalRefused):
    """The point can be reached, but not from here. Go by way of another point."""

    reason = Reason.PATH_BLOCKED

    def __init__(self, point: Sequence[float]) -> None:
        self.point = tuple(point)
        super().__init__(f"no line or arc leads to ({_metres(point)}); go by another point")


class BadArgument(GoalRefused):
    """A number that means nothing here. Correct it."""

    reason = Reason.BAD_ARGUMENT

    def __init__(self, name: str, value: float, allowed: str) -> None:
        self.name, self.value, self.allowed = name, value, allowed
        super().__init__(f"{name} is {value:g}; it must be {allowed}")


class UnknownKind(SimError):
    """No robot of that kind can be simulated."""

    def __init__(self, kind: str, known: Iterable[str]) -> None:
        self.kind, self.known = kind, tuple(known)
        super().__init__(
            f"there is no robot of kind {kind!r} to simulate; choose one of {', '.join(self.known)}"
        )


class CannotListen(SimError, OSError):
    """No client can be served at that address. `cause` is the error of the operating system."""

    def __init__(self, address: str, cause: str) -> None:
        self.address, self.cause = address, cause
        super().__init__(f"cannot listen at {address}: {cause}; {instead(address)}")


def _metres(point: Sequence[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in point[:3])


class MemoryLost(SimError):
    """The files with the leases that a controller has obeyed are damaged or gone. A person must decide."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        advice = "look at the robot, then start it once with --reset-epoch, which obeys any lease again"
        super().__init__(f"{' and '.join(problems)}, so that it is not known which leases are over; {advice}")
