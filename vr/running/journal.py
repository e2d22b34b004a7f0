"""Where a robot's events are written before they have consequences."""

from __future__ import annotations

from typing import Protocol

from robotree.vr.core.events import Event


class Journal(Protocol):
    """Takes the events of robots in the order in which they changed the state."""

    def append(self, robot: str, now: float, event: Event) -> int:
        """Take an event; never blocks.

        Args:
            robot: key of its address.
            now: [s] on the robot's clock: an input of the machine as much as the event is.
            event: as handled, not refused.

        Returns:
            A number for `commit`; 0: there is nothing to wait for.
        """
        ...

    def commit(self, number: int) -> None:
        """Wait until the event, and all before it, would survive the process."""
        ...
