"""When the next batch is due, so that the simulated second stays as long as the real one. Pure."""

from typing import Final

LARGEST_DEBT: Final = 0.25
"""[s] behind the wall clock that is still made good."""


class Pacer:
    """Counts deadlines: they are absolute, so a late wake-up is made good by the next batches.

    Args:
        period: of one batch [s].
        now: the wall clock [s].
    """

    def __init__(self, period: float, now: float) -> None:
        self._period = period
        self._due = now
        self.dropped = 0.0
        """[s] of debt that was dropped so far."""

    def wait(self, now: float) -> float:
        """After a batch: how long to sleep before the next one [s], not below 0."""
        self._due += self._period
        debt = now - self._due
        if debt > LARGEST_DEBT:
            self.dropped += debt
            self._due = now
        return max(-debt, 0.0)
