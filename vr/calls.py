"""The calls a robot has seen, so that the same call sent twice is carried out once and answered twice.

A call's key is `command id / path`. Ended calls are kept, the oldest forgotten first; those that run are
never forgotten. Pure.
"""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from robotree.vr.errors import KeyReused

MOST_KEPT = 256

Job = TypeVar("Job")
Content = tuple[str, dict[str, Any]]
"""Command and arguments, as sent."""


class CallTable(Generic[Job]):
    """What is known of each key: its content, and the job that carries or has carried it out."""

    def __init__(self, robot: str, *, limit: int = MOST_KEPT) -> None:
        """Begin empty.

        Args:
            robot: name, for messages.
            limit: how many ended calls are kept.
        """
        self.robot, self.limit = robot, limit
        self._known: dict[str, tuple[Content, Job]] = {}
        self._ended: dict[str, None] = {}

    def __len__(self) -> int:
        return len(self._known)

    def find(self, key: str, content: Content) -> Job | None:
        """Return the job of a key, or None when the key is new.

        Raises:
            KeyReused: the key came with other content before.
        """
        known = self._known.get(key)
        if known is None:
            return None
        if known[0] != content:
            raise KeyReused(robot=self.robot, key=key, command=known[0][0])
        return known[1]

    def enter(self, key: str, content: Content, job: Job) -> None:
        """Remember a new call."""
        if key in self._known:
            msg = f"{key} is known already"
            raise ValueError(msg)
        self._known[key] = (content, job)

    def end(self, key: str) -> None:
        """Note that a call has ended: from now on it may be forgotten when there are too many."""
        if key in self._known and key not in self._ended:
            self._ended[key] = None
            while len(self._ended) > self.limit:
                oldest = next(iter(self._ended))
                del self._ended[oldest], self._known[oldest]

    def forget(self, key: str) -> None:
        """Forget a call that was not taken in after all."""
        self._known.pop(key, None)
        self._ended.pop(key, None)
