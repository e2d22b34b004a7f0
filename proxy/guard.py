"""Requests that are refused before they reach the wire: a number outside its limits, an epoch that is over.

The controller refuses too, and knows more (reach, path, contact). This check comes first because its answer
is quicker and names the caller's parameters, and because a limit belongs to a place, not to a machine: the
same arm has another workspace in another cell. Each refusal names the value, the limit and its unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType

from robotree.proxy.motion import Motion
from robotree.vr.base.errors import BadArgument, StaleEpoch
from robotree.vr.base.units import Range


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
        return f"{self.lower:g} to {self.upper:g} {self.unit}".rstrip()

    @property
    def range(self) -> Range:
        """The same for the annotation of a command's parameter, so that callers see it."""
        return Range(self.lower, self.upper)


Limits = Mapping[str, Span]
"""The limits of one kind of robot in one place: a span for each number of its motions, by name."""


NO_LIMITS: Limits = MappingProxyType({})
"""No limits: a motion with a number is refused."""


def changed(limits: Limits, changes: Limits) -> Limits:
    """The limits of a kind in another place, where some are different.

    Raises:
        ValueError: a change is of no limit of this kind, so nothing would be limited by it.
    """
    if strange := sorted(changes.keys() - limits.keys()):
        msg = f"there is no limit {', '.join(strange)}; there is: {', '.join(limits)}"
        raise ValueError(msg)
    return {**limits, **changes}


def check(motion: Motion, limits: Limits, *, command: str) -> None:
    """Refuse a motion with any value out of its limit. A value for which no limit is known is refused, too.

    Raises:
        BadArgument: it names the command and the first such value.
    """
    for name, value in asdict(motion).items():
        span = limits.get(name)
        if span is None:
            raise BadArgument(
                command=command, parameter=name, reason="this robot knows no limit for it; not sent"
            )
        if value not in span:
            raise BadArgument(command=command, parameter=name, reason=_out_of(value, span))


def _out_of(value: float, span: Span) -> str:
    if math.isnan(value):
        return f"is not a number; give one from {span}"
    return f"{value:g} {span.unit} is outside {span}"


@dataclass(slots=True)
class EpochCheck:
    """The highest epoch seen; a smaller one is a stale fencing token (Kleppmann 2016)."""

    robot: str
    highest: int = field(default=0)

    def admit(self, epoch: int) -> None:
        """Accept a command of this epoch, and none of a smaller one from now on.

        Raises:
            StaleEpoch: a larger one was seen.
        """
        if epoch < self.highest:
            raise StaleEpoch(robot=self.robot, epoch=epoch, current=self.highest)
        self.highest = epoch

    def raise_to(self, epoch: int) -> None:
        """The controller has seen this epoch."""
        self.highest = max(self.highest, epoch)
