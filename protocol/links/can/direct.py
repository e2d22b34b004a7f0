"""A port to an interface that never blocks and can be watched: used from the event loop itself."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import can

from robotree.protocol.links.can.port import SEND_WITHIN, Port, frame

if TYPE_CHECKING:
    import asyncio

_RETRY = 0.002
"""[s]"""
_BATCH = 64
"""Frames to take before other parts of the program get their turn."""


@runtime_checkable
class Buffered(Protocol):
    """A bus that takes many frames from the system at once and knows how many are left."""

    @property
    def pending(self) -> int:
        """Frames to be had without asking the system."""
        ...


class DirectPort(Port):
    """Watches the descriptor of its bus."""

    def __init__(self, bus: can.BusABC, *, fd: bool) -> None:
        super().__init__(bus, fd=fd)
        self._queue: list[tuple[int, int, can.Message]] = []
        self._count = 0
        self._refused_since: float | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._buffered = bus if isinstance(bus, Buffered) else None
        self._descriptor = bus.fileno()
        self._loop.add_reader(self._descriptor, self._readable)

    @property
    def congested(self) -> bool:
        """Whether any frame waits."""
        return bool(self._queue)

    def send(self, arbitration_id: int, data: bytes, *, fd: bool) -> None:
        """Send a frame, or queue it."""
        if not self._open:
            return
        message = frame(arbitration_id, data, fd=fd)
        if self._queue or not self._give(message):
            self._count += 1
            heapq.heappush(self._queue, (arbitration_id, self._count, message))
            if self._retry is None:
                self._retry = self._loop.call_later(_RETRY, self._drain)

    def leave(self) -> asyncio.Future[None]:
        """Send what the bus takes at once, and leave it."""
        if self._open:
            self._drain()
            self._open = False
            self._stop()
        return self._loop.run_in_executor(None, self._shut)

    def _give(self, message: can.Message) -> bool:
        try:
            self.bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            now = self._loop.time()
            self._refused_since = now if self._refused_since is None else self._refused_since
            if now - self._refused_since > SEND_WITHIN:
                self._break(str(error))
            return False
        self._refused_since = None
        return True

    def _drain(self) -> None:
        self._retry = None
        if not self._queue:
            return
        while self._queue and self._open:
            if not self._give(self._queue[0][2]):
                self._retry = self._loop.call_later(_RETRY, self._drain)
                return
            heapq.heappop(self._queue)
        if self._open and self.user is not None:
            self.user.room()

    def _readable(self) -> None:
        for _ in range(_BATCH):
            if not self._open:
                return
            try:
                message = self.bus.recv(0)
            except (can.CanError, OSError, ValueError) as error:
                self._fail_to_receive(error)
                return
            if message is None:
                return
            self._take(message)
            if self._buffered is not None and not self._buffered.pending:
                return  # the descriptor becomes readable when there is more

    def _stop(self) -> None:
        self._loop.remove_reader(self._descriptor)
        self._buffered = None
        if self._retry is not None:
            self._retry.cancel()
