"""One node's door to a bus: frames out in order of urgency, frames in, whatever python-can's interface is.

Interfaces that never block and can be watched (`DIRECT`) are used from the event loop itself; all others get
a thread that reads and one that writes.
"""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import can
import msgspec

from robotree.protocol.errors import LinkRefused

if TYPE_CHECKING:
    from robotree.protocol.links.can.address import CanAddress

DIRECT = frozenset({"robotree", "socketcan", "udp_multicast"})
"""Interfaces with a descriptor to watch, whose `send` does not wait."""
PATIENCE = 1.0
"""[s] that a bus may refuse to take a frame before it counts as broken."""
MOST_ERRORS = 100
"""Failed receptions in a row that mean that the bus is broken; a single one can be a stray datagram."""
_RETRY = 0.002
"""[s]"""
_BATCH = 64
"""Frames to take before other parts of the program get their turn."""


class PortStatistics(msgspec.Struct, frozen=True):
    """One reading of a port's gauges."""

    sent: int
    """Frames that the bus took."""
    received: int
    """Frames that the bus handed out."""
    errors: int
    """Receptions that failed, and error frames."""
    waiting: int
    """Frames that the bus has not taken yet."""


class Tenant(Protocol):
    """Lives behind a port."""

    def heard(self, message: can.Message) -> None:
        """A data frame came."""
        ...

    def room(self) -> None:
        """The bus took all that waited."""
        ...

    def broke(self, cause: str) -> None:
        """The bus is of no more use; told once, and nothing is told after it."""
        ...


@runtime_checkable
class Buffered(Protocol):
    """A bus that takes many frames from the system at once and knows how many are left."""

    @property
    def pending(self) -> int:
        """Frames to be had without asking the system."""
        ...


class Port:
    """What all ports have in common. The event loop's thread alone calls it."""

    def __init__(self, bus: can.BusABC, *, fd: bool) -> None:
        self.bus, self.fd = bus, fd
        self.tenant: Tenant | None = None
        """Must be set before the event loop runs again."""
        self._loop = asyncio.get_running_loop()
        self._open = True
        self._sent: int = 0
        self._received = self._errors = self._failures = 0

    @property
    def waiting(self) -> int:
        """Frames that the bus has not taken yet."""
        raise NotImplementedError

    @property
    def congested(self) -> bool:
        """Whether so many wait that more had better wait where they can still be superseded."""
        raise NotImplementedError

    @property
    def statistics(self) -> PortStatistics:
        """The gauges now."""
        return PortStatistics(self._sent, self._received, self._errors, self.waiting)

    def send(self, arbitration_id: int, data: bytes, *, fd: bool) -> None:
        """Send a frame, or queue it. Never blocks, never raises.

        Args:
            arbitration_id: 29 bits.
            data: the data field, of a size that its format allows.
            fd: the format.
        """
        raise NotImplementedError

    def leave(self) -> asyncio.Future[None]:
        """Send what the bus still takes, and leave it; done when it is left. Harmless when repeated."""
        raise NotImplementedError

    def _take(self, message: can.Message) -> None:
        self._failures = 0
        self._received += 1
        if message.is_error_frame:
            self._errors += 1
        elif self._open and self.tenant is not None and not message.is_remote_frame:
            self.tenant.heard(message)

    def _fail_to_receive(self, error: Exception) -> None:
        self._errors += 1
        self._failures += 1
        if self._failures >= MOST_ERRORS:
            self._break(f"{MOST_ERRORS} receptions in a row failed, the last one because: {error}")

    def _break(self, cause: str) -> None:
        if self._open:
            self._open = False
            self._stop()
            if self.tenant is not None:
                self.tenant.broke(cause)

    def _stop(self) -> None:
        """Hear the bus no more."""


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
    def waiting(self) -> int:
        """Frames that the bus has not taken yet."""
        return len(self._queue)

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
        return self._loop.run_in_executor(None, self.bus.shutdown)

    def _give(self, message: can.Message) -> bool:
        try:
            self.bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            now = self._loop.time()
            self._refused_since = now if self._refused_since is None else self._refused_since
            if now - self._refused_since > PATIENCE:
                self._break(str(error))
            return False
        self._refused_since = None
        self._sent += 1
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
        if self._open and self.tenant is not None:
            self.tenant.room()

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
                return  # the descriptor tells when there is more

    def _stop(self) -> None:
        self._loop.remove_reader(self._descriptor)
        if self._retry is not None:
            self._retry.cancel()


def frame(arbitration_id: int, data: bytes, *, fd: bool) -> can.Message:
    """A data frame as python-can wants it."""
    return can.Message(
        arbitration_id=arbitration_id, data=data, is_fd=fd, bitrate_switch=fd, is_extended_id=True
    )


async def open_port(address: CanAddress) -> Port:
    """Go onto a bus.

    Raises:
        LinkRefused: the interface does not exist, or the bus cannot be had.
    """
    from robotree.protocol.links.can.threaded import ThreadedPort

    open_bus: Callable[..., can.BusABC] = can.Bus
    try:
        bus = await asyncio.to_thread(
            open_bus, interface=address.interface, channel=address.channel, **address.bus_options
        )
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise LinkRefused(str(address), str(error) or type(error).__name__) from error
    kind = DirectPort if address.interface in DIRECT else ThreadedPort
    return kind(bus, fd=address.fd)
