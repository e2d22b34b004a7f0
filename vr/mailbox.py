"""The order of a robot's commands: one at a time, the others wait in a bounded queue.

Commands that only read run beside the others. Control (leases, stops, cancels) is not in here at all: it
is carried out when it arrives, however many commands wait. Pure: keys in, keys out.
"""

from __future__ import annotations

from collections import deque

from robotree.vr.errors import Busy

LONGEST_QUEUE = 16
MOST_READERS = 32


class Mailbox:
    """Which command runs, which ones wait."""

    def __init__(self, robot: str, *, limit: int = LONGEST_QUEUE) -> None:
        """Begin empty.

        Args:
            robot: name, for messages.
            limit: how many commands may wait.
        """
        self.robot, self.limit = robot, limit
        self.running = ""
        """Key of the command whose turn it is; empty: none."""
        self.readers: set[str] = set()
        self._waiting: deque[str] = deque()

    @property
    def waiting(self) -> tuple[str, ...]:
        """Keys of the commands that wait, the next one first."""
        return tuple(self._waiting)

    def offer(self, key: str, *, reads: bool) -> bool:
        """Take a command in.

        Args:
            key: of the command, not known yet.
            reads: it only reads.

        Returns:
            Whether it runs at once; else `leave` of an earlier one will name it.

        Raises:
            Busy: too many wait already.
        """
        if reads:
            if len(self.readers) >= MOST_READERS:
                raise Busy(robot=self.robot, waiting=len(self.readers))
            self.readers.add(key)
            return True
        if not self.running:
            self.running = key
            return True
        if len(self._waiting) >= self.limit:
            raise Busy(robot=self.robot, waiting=len(self._waiting))
        self._waiting.append(key)
        return False

    def leave(self, key: str) -> str:
        """Let a command out, wherever it is.

        Returns:
            The key of the command whose turn it is now because of that; empty if there is none.
        """
        self.readers.discard(key)
        if key != self.running:
            if key in self._waiting:
                self._waiting.remove(key)
            return ""
        self.running = self._waiting.popleft() if self._waiting else ""
        return self.running
