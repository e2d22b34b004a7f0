"""The base of a simulated machine's files and sockets: descriptors, and faults by chance."""

from __future__ import annotations

import errno
import itertools
import math
import random
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol, Self

from robotree.vr.base.os_files import CLOSED_THERE, FAILED, HUNG_UP, READABLE, WRITABLE
from robotree.vr.world.disk import fail
from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner, VirtualWaiter

STANDARD = 3
"""Descriptors that every process has: its input and outputs."""

MOST_DESCRIPTORS = 1024
"""Of one process."""


@dataclass
class Trouble:
    """The faults of all processes by chance. May be changed at any time."""

    split: float = 0.0
    """Share of the sends that arrive in two pieces."""
    pause: float = 0.002
    """[s] between two pieces at most."""
    jitter: float = 0.0
    """[s] that everything is under way at most."""
    small: float = 0.0
    """Share of the connections in which there is little room."""
    full_backlog: float = 0.0
    """Share of the dials that find no place in line."""
    late_accept: float = 0.0
    """[s] that a listener learns late of a connection at most."""
    late_wake: float = 0.0
    """[s] that a thread which waits for sockets wakes late at most."""
    slow_death: float = 0.0
    """[s] between two descriptors at most that are closed when a process dies."""


class Descriptor(Protocol):
    """The object behind a descriptor's number."""

    number: int

    def release(self) -> None:
        """It is closed."""
        ...


class Kernel:
    """The state that all processes of a machine share, and its faults by chance."""

    def __init__(self, runner: VirtualRunner, seed: int) -> None:
        """Begin without trouble.

        Args:
            runner: in whose time it runs.
            seed: of its chance.
        """
        self.runner, self.random = runner, random.Random(f"{seed} machine")
        self.trouble = Trouble()
        self.calls = 0
        """System calls."""
        self.checksum = 0
        """Of all bytes that were sent, by whom, and when: equal for equal traces."""

    def call(self) -> None:
        """Somebody asks something of the machine."""
        self.calls += 1
        self.runner.point()

    def note_sent(self, pid: int, data: bytes) -> None:
        """Add what a process has sent to the checksum."""
        self.checksum = zlib.crc32(b"%d %r " % (pid, self.runner.now()) + data, self.checksum)

    def happens(self, share: float) -> bool:
        """Whether something happens that has this share; nothing is drawn if it cannot."""
        return bool(share) and self.random.random() < share

    def later(self, longest: float, action: Callable[[], object]) -> None:
        """Have something happen within some time [s]."""
        self.runner.at(self.runner.now() + self.random.random() * longest, action)


class Descriptors:
    """The open descriptors of one process."""

    def __init__(self, kernel: Kernel, process: VirtualProcess) -> None:
        """Begin with nothing open."""
        self.kernel, self.process = kernel, process
        self.descriptors: dict[int, Descriptor] = {}
        self.most_descriptors = MOST_DESCRIPTORS

    def check_descriptors(self) -> None:
        """Check that there is a free descriptor.

        Raises:
            OSError: there is none (EMFILE).
        """
        if len(self.descriptors) + STANDARD >= self.most_descriptors:
            fail(errno.EMFILE)

    def take(self, one: Descriptor) -> int:
        """Give something the lowest free descriptor.

        Raises:
            OSError: there is none (EMFILE).
        """
        self.check_descriptors()
        number = next(free for free in itertools.count(STANDARD) if free not in self.descriptors)
        self.descriptors[number] = one
        return number

    def give_back(self, number: int) -> None:
        """Close a descriptor.

        Raises:
            OSError: it is not open (EBADF).
        """
        one = self.descriptors.pop(number, None)
        if one is None:
            fail(errno.EBADF)
        one.release()


CAPACITY: Final = 212_992
"""[bytes] that may lie in a connection: net.core.wmem_default."""

_ALWAYS: Final = HUNG_UP | FAILED
"""Events that are reported whether asked for or not."""


class SimulatedSocket:
    """A Unix socket of a simulated machine."""

    def __init__(self, system: Descriptors) -> None:
        """Make one that is neither connected nor listens, and has no descriptor yet."""
        self.system, self.kernel = system, system.kernel
        self.number = -1
        self.peer: SimulatedSocket | None = None
        self.incoming: deque[bytes] = deque()
        """The data that has come, in the pieces in which it was sent."""
        self.size = 0
        """[bytes] of it and of what is under way."""
        self.capacity = CAPACITY
        self.under_way: deque[bytes | None] = deque()
        """The data that comes later; None: the end."""
        self.stalled = False
        """Whether what is under way stays there."""
        self.no_more = self.broken = False
        """Whether nothing comes any more; whether nothing can be sent any more."""
        self.error = 0
        self.watchers: list[SimulatedEpoll] = []
        self.listens = False
        self.path = ""
        self.changed = 0
        """[ns] When it got its path."""
        self.queue: deque[SimulatedSocket] = deque()
        self.backlog = 0
        self.on_release: Callable[[], object] = lambda: None
        """Called when one that listens is closed."""

    # -- as `Socket` ------------------------------------------------------------------------------

    def fileno(self) -> int:
        return self.number

    def setblocking(self, flag: bool, /) -> None:  # noqa: FBT001 # as `socket.socket`
        """As `socket.socket.setblocking`: none waits."""

    def settimeout(self, seconds: float | None, /) -> None:
        """As `socket.socket.settimeout`: none waits."""

    def getpeername(self) -> str:
        """As `socket.socket.getpeername`: nobody shares a realm here."""
        return ""

    def send(self, data: Any, flags: int = 0, /) -> int:
        del flags
        self.kernel.call()
        self._check_open()
        peer = self.peer
        if self.broken or peer is None:
            fail(errno.EPIPE if peer is not None else errno.ENOTCONN)
        room = peer.capacity - peer.size
        if room <= 0:
            fail(errno.EAGAIN)
        piece, trouble = bytes(data[:room]), self.kernel.trouble
        peer.size += len(piece)
        self.kernel.note_sent(self.system.process.pid(), piece)
        if peer.under_way or peer.stalled or trouble.jitter:
            peer.come_later([piece])
        elif len(piece) > 1 and self.kernel.happens(trouble.split):
            cut = self.kernel.random.randrange(1, len(piece))
            peer.come_later([piece[:cut], piece[cut:]])
        else:
            peer.arrive(piece)
        return len(piece)

    def sendall(self, data: Any, flags: int = 0, /) -> None:
        while data:
            try:
                data = data[self.send(data, flags) :]
            except BlockingIOError:
                self.system.process.waiter().wait(0.001)

    def recv(self, size: int, /) -> bytes:
        self.kernel.call()
        self._check_open()
        if not self.incoming:
            if self.error:
                error, self.error = self.error, 0
                fail(error)
            if not self.no_more:
                fail(errno.EAGAIN)
            return b""
        taken, whole = bytearray(), False
        while self.incoming and len(taken) < size:
            piece = self.incoming.popleft()
            missing = size - len(taken)
            if len(piece) > missing:
                self.incoming.appendleft(piece[missing:])
                piece = piece[:missing]
            else:
                whole = True
            taken += piece
        self.size -= len(taken)
        if whole and self.peer is not None and self.peer.writable:
            self.peer.edge(WRITABLE)
        return bytes(taken)

    def accept(self) -> tuple[SimulatedSocket, str]:
        self.kernel.call()
        self._check_open()
        self.system.check_descriptors()
        if not self.queue:
            fail(errno.EAGAIN)
        line = self.queue.popleft()
        line.number = self.system.take(line)
        return line, ""

    def shutdown(self, how: int, /) -> None:
        del how
        self.kernel.call()
        self._check_open()
        for end in (self, self.peer):
            if end is not None:
                end.broken = True
                end.end_comes()

    def close(self) -> None:
        if self.number >= 0:
            self.system.give_back(self.number)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- for the machine --------------------------------------------------------------------------

    def release(self) -> None:
        """Its last descriptor is closed."""
        self.number = -1
        for watcher in list(self.watchers):
            watcher.forget(self)
        if self.listens:
            self.on_release()
            self.listens = False
            for line in self.queue:  # their dialers have lost them
                line.reset()
        peer = self.peer
        if peer is not None:
            if self.incoming or self.under_way:
                peer.error = peer.error or errno.ECONNRESET
            peer.broken = True
            peer.end_comes()
        self.incoming.clear()
        self.under_way.clear()
        self.size, self.no_more, self.broken = 0, True, True

    def reset(self) -> None:
        """The connection ends, and what it held is lost."""
        for end in (self, self.peer):
            if end is not None:
                end.under_way.clear()
                end.broken = end.no_more = True
                end.error = errno.ECONNRESET
                end.edge(0)

    @property
    def writable(self) -> bool:
        """Whether there is much room for more: unix_writable() in net/unix/af_unix.c."""
        peer = self.peer
        return peer is None or 4 * peer.size <= peer.capacity

    def events(self) -> int:
        """Return what it is ready for."""
        if self.listens:
            return READABLE if self.queue else 0
        found = FAILED if self.error else 0
        if self.peer is None:
            return found | HUNG_UP | WRITABLE
        if self.no_more and self.broken:
            found |= HUNG_UP
        if self.no_more:
            found |= READABLE | CLOSED_THERE
        if self.incoming:
            found |= READABLE
        return found | (WRITABLE if self.writable else 0)

    def edge(self, events: int) -> None:
        """Report that it has become ready for something; 0: for anything."""
        for watcher in self.watchers:
            watcher.note(self, events)

    def arrive(self, piece: bytes) -> None:
        """Something has come."""
        if not self.no_more:
            self.incoming.append(piece)
            self.edge(READABLE)

    def end_comes(self) -> None:
        """The far end has closed, or this one: nothing comes behind what is under way."""
        if self.under_way:
            self.under_way.append(None)
        else:
            self.no_more = True
            self.edge(0)

    def come_later(self, pieces: list[bytes]) -> None:
        """Let something arrive after a while, in its order."""
        idle = not self.under_way
        self.under_way.extend(pieces)
        if idle and not self.stalled:
            self._expect_next()

    def go_on(self) -> None:
        """Let what is stalled go on."""
        self.stalled = False
        if self.under_way:
            self._expect_next()

    def _expect_next(self) -> None:
        trouble = self.kernel.trouble
        self.kernel.later(trouble.jitter or trouble.pause, self._land)

    def _land(self) -> None:
        """The next piece arrives."""
        if self.stalled or not self.under_way:
            return
        piece = self.under_way.popleft()
        if piece is None:
            self.no_more = True
            self.edge(0)
        else:
            self.arrive(piece)
        if self.under_way:
            self._expect_next()

    def _check_open(self) -> None:
        if self.number < 0:
            fail(errno.EBADF)


class SimulatedEpoll:
    """See `system.Epoll`; what is ready is reported once (EPOLLET), as all here ask for it."""

    def __init__(self, system: Descriptors) -> None:
        """Make one that waits for nothing."""
        self.system, self.kernel = system, system.kernel
        self.closed = False
        self._wanted: dict[SimulatedSocket, int] = {}
        self._ready: dict[SimulatedSocket, None] = {}
        """Sockets that have become ready since they were reported, in this order."""
        self._waiting: list[VirtualWaiter] = []
        self.number = system.take(self)

    def fileno(self) -> int:
        return self.number

    def register(self, fd: SimulatedSocket, eventmask: int = 0, /) -> None:
        self.kernel.call()
        self._check(fd)
        if fd in self._wanted:
            fail(errno.EEXIST)
        fd.watchers.append(self)
        self._want(fd, eventmask)

    def modify(self, fd: SimulatedSocket, eventmask: int, /) -> None:
        self.kernel.call()
        self._check(fd)
        if fd not in self._wanted:
            fail(errno.ENOENT)
        self._want(fd, eventmask)

    def unregister(self, fd: SimulatedSocket, /) -> None:
        self.kernel.call()
        self._check(fd)
        if fd not in self._wanted:
            fail(errno.ENOENT)
        self.forget(fd)

    def poll(self, timeout: float | None = None, /) -> list[tuple[int, int]]:
        """As `select.epoll.poll`. Of several that wait, the one that came last is woken."""
        self._check_open()
        self.kernel.call()
        found = self._take()
        if found or timeout == 0.0:
            return found
        now = self.system.process.now
        end = math.inf if timeout is None else now() + math.ceil(timeout * 1000) / 1000  # epoll_wait(2)
        while not found and now() < end and not self.closed:
            waiter = self.system.process.waiter()
            self._waiting.append(waiter)
            woken = waiter.wait(None if end == math.inf else end - now())
            if waiter in self._waiting:
                self._waiting.remove(waiter)
            found = self._take()
            if not woken:
                break
        return found

    def close(self) -> None:
        if not self.closed:
            self.system.give_back(self.number)

    # -- for the machine --------------------------------------------------------------------------

    def release(self) -> None:
        """Its descriptor is closed."""
        self.closed = True
        for one in list(self._wanted):
            self.forget(one)

    def forget(self, one: SimulatedSocket) -> None:
        """Wait for it no longer."""
        del self._wanted[one]
        self._ready.pop(one, None)
        one.watchers.remove(self)

    def note(self, one: SimulatedSocket, events: int) -> None:
        """A socket has become ready for something; 0: for anything."""
        if events and not events & (self._wanted[one] | _ALWAYS):
            return
        self._ready[one] = None
        if self._waiting:
            late = self.kernel.trouble.late_wake
            waiter = self._waiting.pop()
            if late:
                self.kernel.later(late, waiter.wake)
            else:
                waiter.wake()

    def _want(self, one: SimulatedSocket, events: int) -> None:
        self._wanted[one] = events
        if one.events() & (events | _ALWAYS):
            self.note(one, 0)

    def _take(self) -> list[tuple[int, int]]:
        ready, self._ready = self._ready, {}
        found = ((one, one.events() & (self._wanted[one] | _ALWAYS)) for one in ready)
        return [(one.number, events) for one, events in found if events]

    def _check(self, one: SimulatedSocket) -> None:
        self._check_open()
        if one.number < 0:
            raise ValueError("file descriptor cannot be a negative integer (-1)")

    def _check_open(self) -> None:
        if self.closed:
            raise ValueError("I/O operation on closed epoll object")
