"""What may be spent, and when: a token bucket. Pure."""


class Allowance:
    """A token bucket; `now` comes from the caller.

    Args:
        burst: that may be spent at once.
        now: the clock [s].
        credit: that there is at the beginning; None: a whole burst.
    """

    def __init__(self, burst: float, now: float, credit: float | None = None) -> None:
        self._burst, self._since = burst, now
        self._credit = burst if credit is None else credit

    def wait(self, rate: float, now: float) -> float:
        """How long to wait before more may be spent [s], at a `rate` [1/s] at which credit grows."""
        self._credit = min(self._credit + rate * (now - self._since), self._burst)
        self._since = now
        return max(-self._credit / rate, 0.0)

    def take(self, most: float, rate: float, now: float) -> float:
        """Spend at most so much at once, and no more than there is; returns how much."""
        self.wait(rate, now)
        taken = max(min(most, self._credit), 0.0)
        self.spend(taken)
        return taken

    def spend(self, amount: float) -> None:
        """Spend; the last piece may be more than there is."""
        self._credit -= amount
