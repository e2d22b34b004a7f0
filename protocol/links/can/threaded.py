"""A port to an interface that blocks or cannot be watched: one thread reads, one writes."""

from __future__ import annotations

import contextlib
import queue
import threading
from typing import TYPE_CHECKING

import can

from robotree.protocol.links.can.port import SEND_WITHIN, Port, frame

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

_GLANCE = 0.2
"""[s] after which a thread looks whether it shall end."""
_WINDOW = 8
"""Frames."""
_CLOSING = 2.0
"""[s] that the threads may take to end."""


class ThreadedPort(Port):
    """Frames cross between the event loop and two threads."""

    def __init__(self, bus: can.BusABC, *, fd: bool) -> None:
        super().__init__(bus, fd=fd)
        self._queue: queue.PriorityQueue[tuple[int, int, can.Message | None]] = queue.PriorityQueue()
        self._count = self._sent = 0
        self._ending = threading.Event()
        self._threads = [
            threading.Thread(target=work, name=f"{bus.channel_info} {work.__name__}", daemon=True)
            for work in (self._read, self._write)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def waiting(self) -> int:
        """Frames that the bus has not taken yet."""
        return self._count - self._sent

    @property
    def congested(self) -> bool:
        """Whether more frames wait than it takes to keep the thread busy."""
        return self.waiting >= _WINDOW

    def send(self, arbitration_id: int, data: bytes, *, fd: bool) -> None:
        """Queue a frame for the writing thread."""
        if self._open:
            self._count += 1
            self._queue.put((arbitration_id, self._count, frame(arbitration_id, data, fd=fd)))

    def leave(self) -> asyncio.Future[None]:
        """Send what waits, and leave the bus."""
        self._open = False
        self._stop()
        return self._loop.run_in_executor(None, self._join)

    def _join(self) -> None:
        for thread in self._threads:
            thread.join(_CLOSING)
        self._shut()

    def _stop(self) -> None:
        self._ending.set()
        self._queue.put((1 << 32, 0, None))  # behind everything that waits

    def _tell(self, what: Callable[..., None], *arguments: object) -> None:
        """Call something in the event loop's thread, if the loop still runs."""
        with contextlib.suppress(RuntimeError):  # it is closed
            self._loop.call_soon_threadsafe(what, *arguments)

    def _read(self) -> None:
        bus = self.bus
        while not self._ending.is_set():
            try:
                message = bus.recv(_GLANCE)
            except (can.CanError, OSError, ValueError) as error:
                self._tell(self._fail_to_receive, error)
                self._ending.wait(0.001)
            else:
                if message is not None:
                    self._tell(self._take, message)

    def _write(self) -> None:
        bus = self.bus
        while (message := self._queue.get()[2]) is not None:
            try:
                bus.send(message, timeout=SEND_WITHIN)
            except (can.CanError, OSError) as error:
                self._tell(self._break, str(error))
                return
            self._tell(self._gave)

    def _gave(self) -> None:
        self._sent += 1
        if not self.waiting and self._open and self.user is not None:
            self.user.room()
