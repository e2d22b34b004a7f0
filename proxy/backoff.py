"""How long to wait before dialling a dead controller again.

Doubling with a ceiling, and jitter: each wait is drawn evenly between half of the doubled value and all of
it, so that a dozen proxies that lost one switch do not come back in step. Chance is an argument.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field


@dataclass(slots=True)
class Backoff:
    """The waits between attempts; `reset` after a success.

    >>> backoff = Backoff(chance=random.Random(1))
    >>> [round(backoff.next_wait(), 2) for _ in range(6)]
    [0.06, 0.18, 0.35, 0.5, 1.2, 1.45]
    """

    chance: random.Random
    first: float = 0.1
    """[s] longest first wait."""
    ceiling: float = 2.0
    """[s] longest wait of all: a controller that was switched on is found within it."""
    attempts: int = field(default=0, init=False)
    """Failures since the last success."""

    def next_wait(self) -> float:
        """Count one failure and return how long to wait [s] before the next attempt."""
        longest = min(self.ceiling, self.first * 2.0 ** min(self.attempts, 30))
        self.attempts += 1
        return longest * (0.5 + 0.5 * self.chance.random())

    def reset(self) -> None:
        """An attempt succeeded."""
        self.attempts = 0
