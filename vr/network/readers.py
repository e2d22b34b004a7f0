"""The threads that read the network of a process, and carry out what begins with what they read.

Handing a call from the thread that reads it to a worker takes 20 us, a fifth of the call. So the thread that
reads it carries the command out (`after_reading`), and others read meanwhile: one reader at least reads, or
waits for something to read, whatever the others carry out. A stop, a cancel or a renewal is read at once. A
reader that never comes back from a command has been replaced before it began with it.

All readers wait for the same sockets (epoll(7)). What comes wakes one of them: the one that came last to
wait. One at a time reads from sockets, and takes what is urgent first. So the frames of a connection keep
their order, and callbacks come one at a time.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable
from typing import Final

from robotree.vr.base.os_files import CLOSED_THERE, ON_CHANGE, READABLE, WRITABLE
from robotree.vr.base.system import THIS_SYSTEM, Socket, System
from robotree.vr.network.link import Channel, PeerLink

READER: Final = "mesh"
"""Name of these threads, for people."""

READERS: Final = 2
"""Readers that stay while nothing comes; the second one is made when the first carries something out."""

_COMES: Final = READABLE | CLOSED_THERE | ON_CHANGE
_BULK: Final = Channel.BULK

What = PeerLink | Callable[[], None]
"""The use of a socket: a link, or a function for the moment when something has come."""

Job = Callable[[], bool]
"""Carries something out; returns whether its thread can read again. It must not raise."""

_log = logging.getLogger(__name__)


class Sockets:
    """The sockets that the readers wait for; `selectors` takes 5 us more for each event.

    What has come is reported once (EPOLLET): the thread that takes the report reads until nothing is left.
    """

    def __init__(self, system: System = THIS_SYSTEM) -> None:
        """Begin with none."""
        self._epoll = system.epoll()
        self._what: dict[int, What] = {}
        """The use of each socket, by descriptor."""

    def add(self, sock: Socket, what: What) -> None:
        """Wait for a socket."""
        self._what[sock.fileno()] = what
        self._epoll.register(sock, _COMES)

    def change(self, sock: Socket, *, writes: bool) -> None:
        """Wait for room to write, too, or no longer."""
        if sock.fileno() in self._what:
            self._epoll.modify(sock, _COMES | (WRITABLE if writes else 0))

    def remove(self, sock: Socket) -> None:
        """Wait for it no longer."""
        if self._what.pop(sock.fileno(), None) is not None:
            self._epoll.unregister(sock)

    def wait(self, timeout: float) -> list[tuple[What, int]]:
        """Return what is ready, with its events, after `timeout` [s] at the latest."""
        found = [(self._what.get(number), events) for number, events in self._epoll.poll(timeout)]
        return [(what, events) for what, events in found if what is not None]

    def descriptors(self) -> list[int]:
        """Return the descriptors of all of them, and that by which they are waited for."""
        return [] if self._epoll.closed else [self._epoll.fileno(), *self._what]

    def all(self) -> list[What]:
        """Return what all of them are for."""
        return list(self._what.values())

    def close(self) -> None:
        """Wait for none any more."""
        self._what.clear()
        self._epoll.close()


class Readers:
    """Reads all sockets of a process in one thread."""

    def __init__(
        self,
        sockets: Sockets,
        *,
        serve: Callable[[What, int], bool],
        tick: Callable[[], None],
        period: float,
        system: System,
        wake: Callable[[], None],
        release: Callable[[], None],
    ) -> None:
        """Prepare; `start` begins.

        Args:
            sockets: that are read.
            serve: reads once what is ready; takes its events, returns whether more may have come.
            tick: does what is to be done again and again.
            period: [s] between two ticks.
            system: of the sockets; its threads read.
            wake: makes a socket ready for which there is nothing to read.
            release: called in the last thread when all have ended.
        """
        self.due = 0.0
        """[s, monotonic] when the next tick is to be."""
        self.count = 0
        """Threads that read or wait, those included that are about to leave."""
        self._leaving = 0
        """Those of them that leave the reading to others when they have read what they are at."""
        self._counting = system.lock()
        self._sockets, self._serve_one, self._tick = sockets, serve, tick
        self._period, self._system = period, system
        self._wake, self._release = wake, release
        self._closed = False
        self._urgent: deque[tuple[What, int]] = deque()
        self._others: deque[tuple[What, int]] = deque()
        """Sockets that are ready and that nobody has read yet."""
        self._reading = system.lock()
        """Held by the one thread that reads from sockets."""
        self._free = 0
        """Which thread that is, if it could carry something out; 0: none could."""
        self._job: Job | None = None
        """The job that it carries out next."""

    def start(self) -> None:
        """Read from now on."""
        with self._counting:
            self._start_one()

    def close(self) -> None:
        """End, but for what is being carried out; the last one that reads releases all."""
        self._closed = True
        self._wake()

    def after_reading(self, job: Job) -> bool:
        """See `Transport.after_reading`: only in the thread that reads, and once in its turn."""
        if self._system.here() != self._free:
            return False
        with self._counting:
            if self.count - self._leaving == 1:  # nobody else would read meanwhile
                try:
                    self._start_one()
                except RuntimeError:  # no more threads
                    return False
            self._leaving += 1
        self._free, self._job = 0, job
        return True

    # -- inside -----------------------------------------------------------------------------------

    def _start_one(self) -> None:
        """Have one more thread read."""
        self._system.spawn(self._run, READER)
        self.count += 1

    def _run(self) -> None:
        while not self._closed:
            left = self.due - self._system.now()
            if left <= 0.0:
                self._call_tick(left)
            else:
                ready = self._sockets.wait(left)
                self._enter(ready)
                if not ready and self._one_too_many():
                    return
            job = self._read_all()
            if job is not None and not self._carry_out(job):
                return
        self._leave()
        self._wake()  # the next one

    def _call_tick(self, left: float) -> None:
        """Have the tick done, which was due some time ago [s, negative]."""
        self.due += self._period - left
        self._urgent.append((self._tick, 0))

    def _enter(self, ready: Iterable[tuple[What, int]]) -> None:
        """Have read what is ready."""
        for one in ready:
            what = one[0]
            bulk = isinstance(what, PeerLink) and what.channel is _BULK
            (self._others if bulk else self._urgent).append(one)

    def _read_all(self) -> Job | None:
        """Read what is ready, unless another thread does; return what is to be carried out then."""
        urgent, others, job = self._urgent, self._others, None
        while job is None and (urgent or others) and self._reading.acquire(blocking=False):
            self._free, self._job = self._system.here(), None
            try:
                while urgent or (others and self._job is None):
                    self._read(*(urgent or others).popleft())
            except Exception:  # noqa: BLE001 # what one process says must not end the talk with all others
                _log.exception("what a socket brought could not be handled")
            finally:
                self._free, job = 0, self._job
                self._reading.release()
        if job is not None and (urgent or others):
            self._wake()  # another one
        return job

    def _read(self, what: What, events: int) -> None:
        if self._serve_one(what, events):
            self._enter([(what, events)])
            self._enter(self._sockets.wait(0.0))  # what is urgent goes ahead of the rest of a flood
            if (left := self.due - self._system.now()) <= 0.0:
                self._call_tick(left)  # without it this process would count as one that hangs

    def _one_too_many(self) -> bool:
        """Leave if nothing has come for a while and enough others remain."""
        with self._counting:
            if self.count - self._leaving <= READERS:
                return False
            self.count -= 1
        return True

    def _carry_out(self, job: Job) -> bool:
        """Carry something out while others read; returns whether this thread reads again."""
        self._leave(announced=1)
        if not job():
            return False
        self._system.name_thread(READER)
        with self._counting:
            if self._closed:
                return False
            self.count += 1
        return True

    def _leave(self, announced: int = 0) -> None:
        """One reader less; the last one, which leaves what is closed, releases all.

        Args:
            announced: 1: it is one of `_leaving`. Both counts change at once: between them another reader
                would think that more remain than do, and leave, too.
        """
        with self._counting:
            self._leaving -= announced
            self.count -= 1
            last = not self.count
        if last:
            self._release()
