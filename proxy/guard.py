"""What is refused before it reaches the wire: a number out of its limits, a right that is over.

The controller refuses too, and knows more (reach, path, contact). The guard stands before it because its
answer is quicker and speaks the caller's words, and because a limit belongs to a place, not to a machine: the
same arm has another workspace in another cell. Each refusal names the value, the limit and its unit.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field

from robotree.proxy.motion import Motion, Move
from robotree.vr.errors import BadArgument, StaleEpoch


@dataclass(frozen=True, slots=True)
class Span:
    """A closed interval with its unit.

    Raises:
        ValueError: it is empty or open to infinity; a limit that limits nothing is a mistake.
    """

    lower: float
    upper: float
    unit: str

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower <= self.upper):
            msg = f"no span: {self.lower} to {self.upper} {self.unit}"
            raise ValueError(msg)

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper  # False for NaN

    def __str__(self) -> str:
        return f"{self.lower:g} to {self.upper:g} {self.unit}"


Limits = dict[str, Span]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmLimits:
    """The box of W in which the tool may be sent, and how fast.

    Narrower than the arm in speed, wider in space: whether a point of the box is within reach, only the
    controller knows.
    """

    x: Span = Span(-0.65, 0.65, "m")
    y: Span = Span(-0.65, 0.65, "m")
    z: Span = Span(0.025, 0.80, "m")
    """The finger tips reach 0.02 m below the tool point, and the table is at 0."""
    twist: Span = Span(-math.pi, math.pi, "rad")
    speed: Span = Span(0.005, 0.25, "m/s")
    """An impact's peak force grows with speed: 35 N at 0.05 m/s, 130 N at 0.2 m/s against a hard table."""
    width: Span = Span(0.0, 0.08, "m")


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverLimits:
    """How far one move may lead, and how fast; and the arena around the origin of W that it may not leave."""

    x: Span = Span(-3.0, 3.0, "m")
    y: Span = Span(-3.0, 3.0, "m")
    speed: Span = Span(0.01, 1.0, "m/s")
    arena_x: Span = Span(-1.5, 1.5, "m")
    arena_y: Span = Span(-1.5, 1.5, "m")


def check(motion: Motion, limits: ArmLimits | RoverLimits, *, command: str) -> None:
    """Refuse a motion with any value out of its limit. A value for which no limit is known is refused, too.

    Args:
        motion: what is about to be sent.
        limits: those of this robot in this place.
        command: name of the command, for the sentence.

    Raises:
        BadArgument: it names the first such value.
    """
    spans: Limits = spans_of(limits)
    for name, value in asdict(motion).items():
        span = spans.get(name)
        if span is None:
            raise BadArgument(
                command=command, parameter=name, reason="this robot knows no limit for it; not sent"
            )
        if value not in span:
            raise BadArgument(command=command, parameter=name, reason=_out_of(value, span))


def check_arrival(motion: Move, here: tuple[float, float], limits: RoverLimits, *, command: str) -> None:
    """Refuse a move that would end outside the arena.

    Args:
        motion: what is about to be sent.
        here: (2,) x, y [m] in W, where the base stands now.
        limits: those of this robot in this place.
        command: name of the command, for the sentence.

    Raises:
        BadArgument: it names the direction that leads out.
    """
    ends = {"x": (here[0] + motion.x, limits.arena_x), "y": (here[1] + motion.y, limits.arena_y)}
    for name, (end, span) in ends.items():
        if end not in span:
            reason = f"the move would end at {end:.3f} {span.unit}, the arena is {span}; send it another way"
            raise BadArgument(command=command, parameter=name, reason=reason)


def spans_of(limits: ArmLimits | RoverLimits) -> Limits:
    """The spans of a limits value by name."""
    return {name: getattr(limits, name) for name in type(limits).__dataclass_fields__}


def _out_of(value: float, span: Span) -> str:
    if math.isnan(value):
        return f"is not a number; give one from {span}"
    return f"{value:g} {span.unit} is outside {span}"


@dataclass(slots=True)
class Fence:
    """The highest epoch seen; a smaller one belongs to a lease that is over (fencing, Kleppmann 2016)."""

    robot: str
    highest: int = field(default=0)

    def admit(self, epoch: int) -> None:
        """Let a command of this epoch through, and none of a smaller one from now on.

        Raises:
            StaleEpoch: a larger one was seen.
        """
        if epoch < self.highest:
            raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.highest)
        self.highest = epoch

    def raise_to(self, epoch: int) -> None:
        """Somebody else (the controller) has seen this epoch."""
        self.highest = max(self.highest, epoch)
