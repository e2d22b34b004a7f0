"""Heartbeats: send one each second, and notice peers that are silent."""

from __future__ import annotations

from robotree.protocol.messages import Heartbeat

PERIOD = 1.0
"""[s]"""
SILENCE = 3.0
"""[s]: three heartbeats."""
BEATS = 5
"""Heartbeats in the silence that the far end bears while it must hear us: three in a row may be lost."""


class HeartbeatSender:
    """Says when the next heartbeat is due; the first one at once."""

    def __init__(self) -> None:
        self.period = PERIOD
        """Between two heartbeats, [s]."""
        self.due = float("-inf")
        """When to call `tick` again, [s]."""

    def tick(self, heartbeat: Heartbeat, now: float) -> list[Heartbeat]:
        """The heartbeat to send now, if it is time."""
        if now < self.due:
            return []
        late = now - self.due
        self.due = now + self.period - (late if late < self.period / 2 else 0.0)
        return [heartbeat]

    def keep(self, patience: float) -> None:
        """From the last heartbeat on, beat often enough for who bears a silence of `patience` [s] at most."""
        period = min(PERIOD, patience / BEATS)
        self.due += period - self.period
        self.period = period

    def due_for(self, patience: float) -> float:
        """When to call `tick` again [s], after `keep` with the same patience [s]."""
        return self.due + min(PERIOD, patience / BEATS) - self.period

    def hurry(self) -> None:
        """The state changed: the next `tick` sends."""
        self.due = float("-inf")
