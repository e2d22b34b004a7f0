"""Round trips, told in a few numbers. Pure."""

from __future__ import annotations

import msgspec


class Trips(msgspec.Struct, frozen=True):
    """What became of some questions. Times are of a way there and back, [s]; None: nothing came back."""

    asked: int
    answered: int
    loss: float
    """Share of the questions that nobody answered."""
    shortest: float | None
    median: float | None
    late: float | None
    """99 of 100 took no longer."""
    longest: float | None


def summary(asked: int, times: list[float]) -> Trips:
    """Tell trips in a few numbers.

    Args:
        asked: how many were begun.
        times: of those that ended, [s].
    """
    ordered = sorted(times)
    count = len(ordered)
    return Trips(
        asked=asked,
        answered=count,
        loss=1 - count / asked if asked else 0.0,
        shortest=ordered[0] if ordered else None,
        median=ordered[count // 2] if ordered else None,
        late=ordered[min(count * 99 // 100, count - 1)] if ordered else None,
        longest=ordered[-1] if ordered else None,
    )
