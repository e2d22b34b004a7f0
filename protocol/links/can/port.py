"""One node's door to a bus: frames out in order of urgency, frames in, whatever python-can's interface is.

`Port` is what every port does, `DirectPort` and `ThreadedPort` are the two kinds; `open_port` chooses.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import heapq
import queue
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import can

from robotree.files import forks
from robotree.protocol.errors import LinkRefused
from robotree.protocol.links.in_thread import opened

if TYPE_CHECKING:
    from robotree.protocol.links.can.address import CanAddress

SEND_WITHIN = 1.0
"""[s] that a bus may refuse to take a frame before it counts as broken."""
MOST_ERRORS = 100
"""Failed receptions in a row that mean that the bus is broken; a single one can be a stray datagram."""


class PortUser(Protocol):
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


class Port(ABC):
    """The base of all ports. The event loop's thread alone calls it."""

    def __init__(self, bus: can.BusABC, *, fd: bool) -> None:
        self.bus, self.fd = bus, fd
        self.user: PortUser | None = None
        """Must be set before the event loop runs again."""
        self._loop = asyncio.get_running_loop()
        self._open = True
        forks.owns(self)
        self._failures = 0

    def in_child(self) -> Iterable[int]:
        """See `forks.Owner`. Not every interface of python-can has a descriptor."""
        with contextlib.suppress(NotImplementedError, OSError, ValueError):
            return (self.bus.fileno(),)
        return ()

    @property
    @abstractmethod
    def congested(self) -> bool:
        """Whether so many wait that more had better wait where they can still be superseded."""

    @abstractmethod
    def send(self, arbitration_id: int, data: bytes, *, fd: bool) -> None:
        """Send a frame, or queue it. Never blocks, never raises.

        Args:
            arbitration_id: 29 bits.
            data: the data field, of a size that its format allows.
            fd: the format.
        """

    @abstractmethod
    def leave(self) -> asyncio.Future[None]:
        """Send what the bus still takes, and leave it; done when it is left. Never fails, may be repeated."""

    def _shut(self) -> None:
        """Shut the bus down and release it. May block.

        A pulled adapter takes no last word; python-can then forgets to close its descriptor, for which the
        system keeps the adapter's name. It is closed with the last reference.
        """
        bus: can.BusABC | None = vars(self).pop("bus", None)
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def _take(self, message: can.Message) -> None:
        self._failures = 0
        usual = not (message.is_error_frame or message.is_remote_frame)
        if usual and self._open and self.user is not None:
            self.user.heard(message)

    def _fail_to_receive(self, error: Exception) -> None:
        self._failures += 1
        if self._failures >= MOST_ERRORS:
            self._break(f"{MOST_ERRORS} receptions in a row failed, the last one because: {error}")

    def _break(self, cause: str) -> None:
        if self._open:
            self._open = False
            self._stop()
            if self.user is not None:
                self.user.broke(cause)

    @abstractmethod
    def _stop(self) -> None:
        """Hear the bus no more."""


def frame(arbitration_id: int, data: bytes, *, fd: bool) -> can.Message:
    """A data frame as python-can wants it."""
    return can.Message(
        arbitration_id=arbitration_id, data=data, is_fd=fd, bitrate_switch=fd, is_extended_id=True
    )


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
    """A port to an interface that never blocks: the event loop watches the descriptor of its bus."""

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


_GLANCE = 0.2
"""[s] after which a thread looks whether it shall end."""
_WINDOW = 8
"""Frames."""
_CLOSING = 2.0
"""[s] that the threads may take to end."""


class ThreadedPort(Port):
    """A port to an interface that blocks or cannot be watched: one thread reads, one writes."""

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


DIRECT = frozenset({"robotree", "socketcan", "udp_multicast"})
"""Interfaces with a descriptor to watch, whose `send` does not wait. All others get two threads."""

KERNEL = "socketcan"
"""The interface of the kernel's own CAN."""
_WITHOUT = "or use can:robotree/CHANNEL between programs of this machine, which needs none"
_ADVICE = {
    errno.EAFNOSUPPORT: f"this machine's kernel has no CAN; load it (modprobe can_raw), {_WITHOUT}",
    errno.ENODEV: "this machine has no interface {channel}; plug in its adapter, see its name in ip link, "
    f"{_WITHOUT}",
    errno.ENETDOWN: "{channel} is down; bring it up (ip link set {channel} up type can bitrate BITRATE)",
}
"""Why the kernel's CAN cannot be opened, and what to do."""


async def open_port(address: CanAddress) -> Port:
    """Go onto a bus.

    Raises:
        LinkRefused: the interface does not exist, or the bus cannot be had.
    """
    open_bus: Callable[..., can.BusABC] = can.Bus
    try:
        bus = await opened(
            partial(open_bus, interface=address.interface, channel=address.channel, **address.bus_options),
            lambda bus: bus.shutdown(),
        )
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise LinkRefused(str(address), _cause(address, error)) from error
    kind = DirectPort if address.interface in DIRECT else ThreadedPort
    return kind(bus, fd=address.fd)


def _cause(address: CanAddress, error: Exception) -> str:
    """Why a bus cannot be had: as a sentence where python-can has only the system's number for it."""
    if address.interface == KERNEL and isinstance(error, OSError) and error.errno in _ADVICE:
        return _ADVICE[error.errno].format(channel=address.channel)
    return str(error) or type(error).__name__
