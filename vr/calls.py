"""The calls a robot has seen, so that the same call sent twice is carried out once and answered twice.

A call's key is `command id / path`. Ended calls are kept, the oldest forgotten first; those that run are
never forgotten. Pure.
"""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from robotree.vr.errors import CommandCancelled, KeyReused

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
        self._buried: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._known)

    def find(self, key: str, content: Content) -> Job | None:
        """Return the job of a key, or None when the key is new.

        Raises:
            KeyReused: the key came with other content before.
            CommandCancelled: its cancel came before the call itself.
        """
        if key in self._buried:
            raise CommandCancelled(robot=self.robot, command=content[0], reason=self._buried[key])
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

    def bury(self, key: str, reason: str) -> None:
        """Refuse a call that has not come yet: its cancel overtook it, or its caller gave up waiting."""
        if key not in self._known:
            self._buried[key] = reason
            while len(self._buried) > self.limit:
                del self._buried[next(iter(self._buried))]
