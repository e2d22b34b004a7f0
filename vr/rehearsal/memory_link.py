"""What lies between two members of a network within a process: it passes on, holds back, or is lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from robotree.vr.network.replies import Replies


class Carrier(Protocol):
    """What a link needs of its network."""

    delay: float
    lease: float

    def post(self, delay: float, action: Callable[[], None]) -> None:
        """Do something after `delay` [s]."""
        ...

    def refresh(self) -> None:
        """Let every watcher look again."""
        ...


class Link:
    """One pair's connection. Silence is held back for a lease; then it counts as lost, until it is over."""

    def __init__(self, network: Carrier) -> None:
        """Begin connected."""
        self._network = network
        self._held: list[Callable[[], None]] = []
        self._alarm: asyncio.TimerHandle | None = None
        self._silent = False
        self.lost = False
        self.exchanges: set[Replies] = set()
        """Requests under way over this link."""

    def send(self, action: Callable[[], None]) -> None:
        """Let something happen at the far end."""
        if self.lost:
            return
        if self._silent:
            self._held.append(action)
        else:
            self._network.post(self._network.delay, action)

    def hush(self) -> None:
        """Fall silent, if it is not."""
        if not self._silent:
            self._silent = True
            self._alarm = asyncio.get_running_loop().call_later(self._network.lease, self._give_up)

    def speak(self) -> None:
        """End the silence, if there is one."""
        if not self._silent:
            return
        self._silent = self.lost = False
        if self._alarm is not None:
            self._alarm.cancel()
        held, self._held = self._held, []
        for action in held:
            self.send(action)
        self._network.refresh()

    def lose(self) -> None:
        """Count as lost: what was under way ends, what was held back is gone."""
        self.lost = True
        self._held.clear()
        if self._alarm is not None:
            self._alarm.cancel()
        for replies in self.exchanges:
            self._network.post(self._network.delay, replies.end)  # behind what was sent before
        self.exchanges.clear()

    def _give_up(self) -> None:
        self.lose()
        self._network.refresh()
