"""What has happened and was not told to the rules yet, and how their command waits for it."""

from __future__ import annotations

from collections import deque

from robotree.vr.author.context import Activity
from robotree.vr.scripts.happening import Happening

LONGEST = 500
"""Messages that may wait: more is a flood."""


class ScriptInbox:
    """Takes happenings from any thread; one command takes them out."""

    def __init__(self, activity: Activity) -> None:
        """Begin empty.

        Args:
            activity: the command that takes them out.
        """
        self._waiting: deque[Happening | int] = deque()
        self._activity = activity

    def put(self, happening: Happening | int) -> None:
        """Take in what the script's own acts and partners cause, or the number of an act that has ended."""
        self._waiting.append(happening)
        self._activity.wake()

    def offer(self, happening: Happening) -> bool:
        """Take in what somebody else says; return False if too much waits already."""
        if len(self._waiting) >= LONGEST:
            return False
        self.put(happening)
        return True

    def take(self, within: float) -> Happening | int | None:
        """Return the oldest one, waiting `within` [s] for it at most.

        Raises:
            VrError: the command is to end.
        """
        if not self._waiting:
            self._activity.wait_for(lambda: bool(self._waiting), within)
        return self._waiting.popleft() if self._waiting else None
