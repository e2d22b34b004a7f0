"""TIMESYNC: how far two clocks are apart, and how long a frame takes.

The asker sends its time as ts1 with tc1 = 0; the answer brings ts1 back with the answerer's time as tc1. Half
the round trip is the delay, if both ways take equally long; the error is at most half the round trip, so the
best of the last few exchanges counts (the clock filter of NTP, RFC 5905 section 10). When two exchanges
differ by more than both errors allow, the far clock was set anew, and what was before counts no more.
"""

from __future__ import annotations

from collections import deque

import msgspec

from robotree.protocol.messages import Timesync

PERIOD = 1.0
"""[s]"""
KEPT = 8
"""Exchanges among which the best counts."""
OLDEST_ANSWER = 10.0
"""[s]"""
DRIFT = 2e-4
"""[s/s] by which two clocks may part: a poor quartz is off by 1e-4. More is a step."""
_NANO = 1_000_000_000


def answer(question: Timesync, now: float) -> list[Timesync]:
    """Answer a question; an answer gets none."""
    return [] if question.tc1 else [Timesync(tc1=max(round(now * _NANO), 1), ts1=question.ts1)]


class Estimate(msgspec.Struct, frozen=True):
    """An estimate of the far clock."""

    offset: float
    """[s] to add to our clock to get the far one."""
    delay: float
    """[s] that a frame takes one way."""


class Synchroniser:
    """Asks once in PERIOD, and estimates."""

    def __init__(self) -> None:
        self.due = float("-inf")
        """When to call `tick` again, [s]."""
        self._asked: dict[int, float] = {}
        self._exchanges: deque[Estimate] = deque(maxlen=KEPT)

    @property
    def estimate(self) -> Estimate | None:
        """The best of the latest exchanges; None before the first."""
        return min(self._exchanges, key=lambda each: each.delay, default=None)

    def tick(self, now: float) -> list[Timesync]:
        """The question to send now, if it is time."""
        if now < self.due:
            return []
        self.due = now + PERIOD
        self._asked = {ts1: asked for ts1, asked in self._asked.items() if now - asked <= OLDEST_ANSWER}
        ts1 = round(now * _NANO)
        self._asked[ts1] = now
        return [Timesync(tc1=0, ts1=ts1)]

    def receive(self, reply: Timesync, now: float) -> Estimate | None:
        """Take an answer; None: it is not an answer to a question of ours."""
        asked = self._asked.pop(reply.ts1, None) if reply.tc1 else None
        if asked is None or now - asked > OLDEST_ANSWER:
            return None
        delay = (now - asked) / 2
        new, best = Estimate(offset=reply.tc1 / _NANO - asked - delay, delay=delay), self.estimate
        if best is not None and self._is_step(best, new):
            self._exchanges.clear()
        self._exchanges.append(new)
        return self.estimate

    def _is_step(self, best: Estimate, new: Estimate) -> bool:
        """Whether the far clock was set anew since the best exchange, as it is by a restart."""
        drift = DRIFT * KEPT * PERIOD
        return abs(new.offset - best.offset) > new.delay + best.delay + drift
