"""The interface between the firmware and any simulated robot, and what devices need to check arguments."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from math import isinf, isnan
from typing import Final, Protocol, TypeAlias

from robotree.protocol.messages import Reason, SetpointKind, Verb
from robotree.sim.errors import BadArgument, UnknownVerb

Start: TypeAlias = Callable[[], None]
"""Begins the movement that was prepared."""
Plan: TypeAlias = Callable[[tuple[float, ...]], Start]
"""Checks and plans a verb with its (7,) arguments."""

SINGLE: Final = 2.0**-23
"""Relative distance of neighbouring single-precision numbers (IEEE 754): what the wire can be off."""
WIDEST: Final = 0.08
"""[m] between the fingers of an open gripper; DO_GRIPPER's RELEASE asks for it."""


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


def planned(plans: Mapping[Verb, Plan], verb: int, args: tuple[float, ...]) -> Start:
    """Return the start of a verb's movement, by a device's table of its verbs.

    Raises:
        UnknownVerb: it is not in the table.
        GoalRefused: with the reason, by the verb's own plan.
    """
    if verb not in plans:
        raise UnknownVerb(verb, [known.name for known in plans])
    return plans[Verb(verb)](args)


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


class Device(Protocol):
    """One robot of a cell: a control law below, verbs above."""

    @property
    def verbs(self) -> Collection[Verb]:
        """The verbs that it carries out."""
        ...

    @property
    def setpoint_kinds(self) -> Collection[SetpointKind]:
        """The set-points that it can follow."""
        ...

    @property
    def parameters(self) -> Collection[Tunable]:
        """The parameters that can be tuned, in an order that stays."""
        ...

    @property
    def tuning(self) -> object:
        """The object whose attributes `parameters` are."""
        ...

    def prepare(self, verb: int, args: tuple[float, ...]) -> Start:
        """Check and plan one movement; nothing moves yet.

        Args:
            verb: what to do.
            args: (7,) its arguments as in robotree.xml; NaN means "as it is now".

        Returns:
            What begins the movement, in place of whatever runs; good until time passes.

        Raises:
            GoalRefused: with the reason; nothing has changed.
        """
        ...

    def follow(self, kind: int, args: tuple[float, ...]) -> Start:
        """Check one set-point; nothing changes yet.

        Args:
            kind: what it says, one of `setpoint_kinds`.
            args: (7,) its arguments as in robotree.xml; NaN means "as it is now".

        Returns:
            What follows it from then on, smoothly and within the limits, in place of whatever runs.

        Raises:
            GoalRefused: it lies outside the limits; nothing has changed.
        """
        ...

    def progress(self) -> Progress:
        """How far the movement is that was begun last; a set-point is never done."""
        ...

    def hold(self) -> None:
        """Drop the movement and rest where the robot is, compliantly."""
        ...
