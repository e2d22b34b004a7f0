"""The base of all simulated robots, between the firmware and their control, and what checks arguments."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isinf, isnan, nan
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from robotree.protocol.messages import Reason, SetpointKind, Verb
from robotree.sim.errors import BadArgument

if TYPE_CHECKING:
    from robotree.sim.motion.path import Path

Start: TypeAlias = Callable[[], None]
"""Begins the movement that was prepared."""
Plan: TypeAlias = Callable[[tuple[float, ...]], Start]
"""Checks and plans a verb with its (7,) arguments."""

SINGLE: Final = 2.0**-23
"""Relative distance of neighbouring single-precision numbers (IEEE 754): what the wire can be off."""
WIDEST: Final = 0.08
"""[m] between the fingers of an open gripper; DO_GRIPPER's RELEASE asks for it."""
POINTS: Final = 12
"""Of a way, on the wire."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the running goal is.

    Attributes:
        fraction: 0 to 1.
        done: whether it has ended.
        reason: NONE when it ended well or still runs, else why it failed.
        text: the reason as one sentence; of a goal that ended well, what is worth knowing about it.
        passed: whether who asked may count it as reached, though the robot still goes on to it.
    """

    fraction: float
    done: bool = False
    reason: Reason = Reason.NONE
    text: str = ""
    passed: bool = False


def ended() -> Progress:
    """Nothing runs."""
    return Progress(1.0, done=True)


def pursuing() -> Progress:
    """A set-point is followed, which has no end."""
    return Progress(0.0)


def require(name: str, value: float, lower: float, upper: float, unit: str) -> None:
    """Refuse an argument outside its limits; both are allowed, also as the wire's nearest floats to them.

    Raises:
        BadArgument: it is outside.
    """
    slack = SINGLE * max(abs(lower), abs(upper))
    if not lower - slack <= value <= upper + slack:
        raise BadArgument(name, value, f"{lower:g} to {upper:g} {unit}")


def or_now(name: str, value: float, now: float) -> float:
    """An argument, or what is now where it was not given (NaN).

    Raises:
        BadArgument: it is infinite.
    """
    if isinf(value):
        raise BadArgument(name, value, "finite")
    return now if isnan(value) else value


def speed_or(asked: float, usual: float, slowest: float, top: float) -> float:
    """The speed (m/s) that a goal asked for, or the usual one, which is never above the `top`.

    Raises:
        BadArgument: it is outside `slowest`...`top`.
    """
    speed = or_now("speed", asked, min(usual, top))
    require("speed", speed, slowest, top, "m/s")
    return speed


@dataclass(frozen=True, slots=True)
class Tunable:
    """One number that can be tuned.

    Attributes:
        name: on the wire, at most 16 characters.
        attribute: of the object that owns the value.
        lower: smallest value that is allowed.
        upper: largest value that is allowed.
        text: its unit, and what it does.
    """

    name: str
    attribute: str
    lower: float
    upper: float
    text: str

    def read(self, owner: object) -> float:
        """The value now."""
        return float(getattr(owner, self.attribute))

    def write(self, owner: object, value: float) -> None:
        """Change the value."""
        setattr(owner, self.attribute, value)


Point: TypeAlias = tuple[float, float, float]


class WayAhead(NamedTuple):
    """A way in W: up to `POINTS` points [m], the first where the robot is now, and how long it lasts [s]."""

    points: Sequence[Point] = ()
    duration: float = nan


def way_along(path: "Path", point: Callable[[list[float]], Point]) -> WayAhead:
    """The way along a path; `point`: where in W a pose of it is."""
    ticks = [path.duration * tick / (POINTS - 1) for tick in range(POINTS)]
    return WayAhead([point(path.at(tick).pose.tolist()) for tick in ticks], path.duration)


class Device:
    """One robot of a cell, or one part of its body: a control law below, verbs above.

    Without more it follows no set-points, and tells no ways.

    Args:
        tuning: the object whose attributes can be tuned.
        parameters: which of them can be, in an order that stays.
        plans: what checks and plans each verb.
    """

    setpoint_kinds: Collection[SetpointKind] = ()
    """The set-points that it can follow."""

    def __init__(self, tuning: object, parameters: Collection[Tunable], plans: Mapping[Verb, Plan]) -> None:
        self._plans = plans
        self.tuned: Final = tuning
        self.parameters: Final = parameters
        """The parameters that can be tuned, of `tuned`."""
        self._running: Callable[[], Progress] = ended

    @property
    def verbs(self) -> Collection[Verb]:
        """The verbs that it carries out."""
        return self._plans.keys()

    def prepare(self, verb: int, args: tuple[float, ...]) -> Start:
        """Check and plan one movement; nothing moves yet.

        Args:
            verb: what to do, one of `verbs`.
            args: (7,) its arguments as in robotree.xml; NaN means "as it is now".

        Returns:
            What begins the movement, in place of whatever runs; good until time passes.

        Raises:
            GoalRefused: with the reason; nothing has changed.
        """
        return self._plans[Verb(verb)](args)

    def way(self, verb: int, args: tuple[float, ...]) -> WayAhead:  # noqa: ARG002  none is told
        """The way of a movement, planned and checked as by `prepare`; nothing moves.

        Where it is empty, `prepare` is asked.

        Args:
            verb: as for `prepare`.
            args: as for `prepare`.

        Raises:
            GoalRefused: as `prepare`.
        """
        return WayAhead()

    def follow(self, kind: int, args: tuple[float, ...]) -> Start:
        """Check one set-point; nothing changes yet.

        Args:
            kind: one of `setpoint_kinds`.
            args: (7,) as in robotree.xml; NaN means "as it is now".

        Returns:
            What follows it from then on, smoothly and within the limits of speed and place, in place of
            whatever runs.

        Raises:
            GoalRefused: it lies outside the limits.
        """
        raise NotImplementedError

    def progress(self) -> Progress:
        """How far the movement is that was begun last; a set-point is never done."""
        return self._running()

    def hold(self) -> None:
        """Drop the movement and rest where the robot is, compliantly."""
        raise NotImplementedError
