"""What may be spent, and when: a token bucket. Pure."""


class Allowance:
    """A token bucket; `now` comes from the caller.

    Args:
        burst: that may be spent at once.
        now: the clock [s].
    """

    def __init__(self, burst: float, now: float) -> None:
        self._burst, self._credit, self._since = burst, burst, now

    def wait(self, rate: float, now: float) -> float:
        """How long to wait before more may be spent [s], at a `rate` [1/s] at which credit grows."""
        self._credit = min(self._credit + rate * (now - self._since), self._burst)
        self._since = now
        return max(-self._credit / rate, 0.0)

    def spend(self, amount: float) -> None:
        """Spend; the last piece may be more than there is."""
        self._credit -= amount
