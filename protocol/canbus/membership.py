"""The members of the bus: one takes a seat, greets the others, hears newcomers, drains what waits.

A channel is a row of ports on 127.0.0.1. A member takes the first free port of the row as its seat. The
system frees the seat of a process that ends, however it ends, so the row is a directory that cannot go stale
and needs nobody to keep it.

>>> first_port(5770), first_port("5770")
(5770, 5770)
>>> first_port("arm") == first_port("arm"), first_port("arm") == first_port("rover")
(True, False)

There are fewer rows than names, so two named channels can share a row. They stay two channels: a greeting
carries `channel_id`, and a member refuses the greeting of another channel.

Members are connected each to each; no member relays for others, so none can take the bus down with it and
none slows the others by being busy. One thread per member does what cannot wait until somebody calls the
bus: it answers newcomers and empties backlogs. Frames themselves go from caller to caller.

Two members that join at the same moment may connect twice. Each sends on the connection that it knew first
and hears both, so nothing arrives twice or out of order.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import select
import socket
import threading
from time import monotonic
from typing import TYPE_CHECKING
from zlib import crc32

import msgspec
from can import CanInitializationError

from robotree.files import forks
from robotree.protocol.canbus.records import GREETING_BYTES, Greeting, Records, read_greeting

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from can import Message

HOST = "127.0.0.1"
SEATS = 32
"""Members of one bus, at most."""
DEFAULT = "robotree"
"""The channel of those who name none."""
_NAMED = range(17000, 32000, SEATS)
"""First ports of channels that have a name: below the ports that systems hand out by themselves."""


def first_port(channel: int | str) -> int:
    """The first port of a channel's row.

    Args:
        channel: a port, as a number or in digits, or a name.

    Raises:
        ValueError: the row would leave the range of ports.
    """
    text = str(channel)
    if not (text.isascii() and text.isdigit()):
        return _NAMED[crc32(text.encode()) % len(_NAMED)]
    port = int(text)
    if not 1024 <= port <= 65536 - SEATS:
        raise ValueError(f"channel {port} is no port from 1024 to {65536 - SEATS}; choose one, or a name")
    return port


def channel_id(channel: int | str) -> int:
    """Return the number that identifies a channel in its row: its port, or the CRC-32 of its name.

    Args:
        channel: a port, as a number or in digits, or a name.

    Returns:
        A number below 2^32.
    """
    text = str(channel)
    return int(text) if text.isascii() and text.isdigit() else crc32(text.encode())


BOUND = 256 * 1024
"""[bytes] of the backlog; about 3000 frames of 64 bytes."""
STALLED_AFTER = 0.25
"""[s] for which it reads nothing."""
GLANCE = 0.1
"""[s] that one look counts at most. Who looks again much later was withheld the processor, and so perhaps was
the far end, which may live in the same process."""
SYSTEM_BUFFER = 256 * 1024
"""[bytes] that the system keeps for us on either side."""
_CHUNK = 64 * 1024


class Wire:
    """Records out and in. `put` and `flush` under the owner's lock, `read` by one thread.

    Args:
        connection: to the far end, which has introduced itself.
        token: the far end's.
        channel: what `Message.channel` shall say.
    """

    def __init__(self, connection: socket.socket, token: int, channel: str) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SYSTEM_BUFFER)
        self.connection, self.token = connection, token
        self.descriptor = connection.fileno()
        self.stalled = False
        self.dropped = 0
        """Frames that a stalled far end did not get."""
        self._records = Records(channel)
        self._backlog = bytearray()
        self._looked = self._idle = 0.0

    @property
    def waits(self) -> bool:
        """Whether there is a backlog to flush."""
        return bool(self._backlog)

    @property
    def full(self) -> bool:
        """Whether the backlog has reached its bound, and the far end may still make room."""
        return len(self._backlog) >= BOUND and not self.stalled

    @property
    def intact(self) -> bool:
        """False: what came is no record; the connection is of no more use."""
        return self._records.intact

    def put(self, record: bytes, now: float) -> bool:
        """Send a record, or put it into the backlog, or drop it if the far end is stalled.

        Returns:
            Whether there is a backlog that was not there before.

        Raises:
            OSError: the far end has gone.
        """
        if self.stalled:
            self.dropped += 1
        elif self._backlog:
            self._backlog += record
        elif (sent := self._send(record)) < len(record):
            self._backlog += record[sent:]
            self._looked, self._idle = now, 0.0
            return True
        return False

    def flush(self, now: float) -> None:
        """Send from the backlog what the system takes.

        Raises:
            OSError: the far end has gone.
        """
        sent = self._send(self._backlog)
        del self._backlog[:sent]
        self._idle = 0.0 if sent else self._idle + min(now - self._looked, GLANCE)
        self._looked = now
        if not self._backlog:
            self.stalled = False
        elif len(self._backlog) >= BOUND and self._idle > STALLED_AFTER:
            self.stalled = True

    def read(self) -> list[Message] | None:
        """The frames that have come; None: the far end has gone."""
        try:
            data = self.connection.recv(_CHUNK)
        except BlockingIOError:
            return []
        except OSError:
            return None
        return self._records.feed(data) if data else None

    def _send(self, data: bytes | bytearray) -> int:
        try:
            return self.connection.send(data)
        except BlockingIOError:
            return 0


ANSWER = 1.0
"""[s] to wait at the start for the answers of those who are there."""
LINGER = 1.0
"""[s] that those who have not read everything hold up one who leaves."""
MANNERS = 30.0
"""[s] after which a connection that has not introduced itself is cut."""
MOST_STRANGERS = 64
"""Connections that have not introduced themselves; when more come, the oldest are cut. A member introduces
itself at once."""
_ROUND_MS = 50
"""[ms] after which to look whether somebody makes no room, or does not introduce himself."""


class PendingConnection(msgspec.Struct, eq=False):
    """A connection whose far end has not introduced itself yet."""

    connection: socket.socket
    dialled: bool
    """We asked, and wait for the answer."""
    since: float
    heard: bytes = b""


class Membership:
    """One member's connections to all others.

    Args:
        channel: a name, or the first port in digits; what `Message.channel` shall say.

    Raises:
        CanInitializationError: all seats of the channel are taken.
        ValueError: the channel is no port and no name.
    """

    def __init__(self, channel: str) -> None:
        self._first, self._id, self._channel = first_port(channel), channel_id(channel), channel
        self._token = secrets.randbits(64)
        self.lock = threading.Condition()
        """Guards the connections; told whenever one makes room, comes or goes."""
        self.outlets: tuple[Wire, ...] = ()
        """The connection to send on, for each other member."""
        self.dropped = self.malformed = 0
        self.inlet = select.epoll()
        """Readable when some wire is."""
        self._wires: dict[int, Wire] = {}
        self._pending: dict[int, PendingConnection] = {}
        self._open = True
        self._delayed = False
        self._bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        try:
            self._seat, self.port = self._sit()
        except BaseException:  # also when the system has no socket left
            self.inlet.close()
            os.close(self._bell)
            raise
        forks.owns(self)
        self._dial_all()
        self._thread = threading.Thread(target=self._run, name=f"can {channel}", daemon=True)
        self._thread.start()
        with self.lock:
            self.lock.wait_for(self._all_answered, ANSWER)

    def in_child(self) -> Iterable[int]:
        own = (self._seat.fileno(), self.inlet.fileno(), self._bell) if self._open else ()
        return (*own, *self._wires, *self._pending)

    @property
    def crowded(self) -> bool:
        """Whether somebody has no room for another frame, and may still make some."""
        return self._delayed and any(wire.full for wire in self.outlets)

    def wire(self, descriptor: int) -> Wire | None:
        """The connection with this descriptor."""
        return self._wires.get(descriptor)

    def say(self, record: bytes) -> None:
        """Send a record to every other member. Under the lock."""
        now, begins = monotonic(), False
        for wire in self.outlets:
            try:
                begins |= wire.put(record, now)
            except OSError:
                self.lose(wire)
        if begins:
            self._delayed = True
            os.eventfd_write(self._bell, 1)

    def lose(self, wire: Wire, *, malformed: bool = False) -> None:
        """Forget a connection whose far end has gone, or speaks nonsense."""
        with self.lock:
            if self._wires.get(wire.descriptor) is not wire:
                return
            del self._wires[wire.descriptor]
            self.dropped += wire.dropped
            self.malformed += malformed
            self._hang_up(wire.connection)
            self._count()

    def leave(self) -> None:
        """Wait until the others have read what they were sent, but not for ever; free the seat."""
        with self.lock:
            self.lock.wait_for(lambda: not any(wire.waits for wire in self.outlets), LINGER)
            self._open = False
        os.eventfd_write(self._bell, 1)
        self._thread.join()
        for wire in self._wires.values():
            wire.connection.close()
        for pending in self._pending.values():
            pending.connection.close()
        self._wires.clear()
        self._pending.clear()
        self.outlets = ()
        self._seat.close()
        self.inlet.close()
        os.close(self._bell)

    def _sit(self) -> tuple[socket.socket, int]:
        for port in range(self._first, self._first + SEATS):
            seat = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
            seat.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                seat.bind((HOST, port))
                seat.listen(socket.SOMAXCONN)  # if it is full, a new connection waits a second or more
            except OSError:
                seat.close()
            else:
                return seat, port
        last = self._first + SEATS - 1
        raise CanInitializationError(
            f"bus {self._channel} has no free seat: all ports {self._first} to {last} of {HOST} are taken; "
            "end a member, or use another channel"
        )

    def _dial_all(self) -> None:
        greeting = Greeting(answer=False, channel=self._id, token=self._token).encode()
        for port in range(self._first, self._first + SEATS):
            if port == self.port:
                continue
            try:
                connection = socket.create_connection((HOST, port), ANSWER)
            except OSError:
                continue  # nobody sits there
            try:
                connection.sendall(greeting)
            except OSError:
                connection.close()  # who sat there has just left
            else:
                self._meet(connection, dialled=True)

    def _all_answered(self) -> bool:
        return not any(pending.dialled for pending in self._pending.values())

    def _meet(self, connection: socket.socket, *, dialled: bool) -> None:
        connection.setblocking(False)
        pending = PendingConnection(connection, dialled, monotonic())
        self._pending[connection.fileno()] = pending

    def _run(self) -> None:
        while self._open:
            poll, timeout = self._watched()
            ready = poll.poll(timeout)
            with self.lock:
                for descriptor, _ in ready:
                    self._attend(descriptor)
                self._drain(monotonic())
                self.lock.notify_all()

    def _watched(self) -> tuple[select.poll, int | None]:
        """The events that the thread waits for now; they change with almost every round."""
        poll = select.poll()
        with self.lock:
            for descriptor in (self._bell, self._seat.fileno(), *self._pending):
                poll.register(descriptor, select.POLLIN)
            waiting = [wire.descriptor for wire in self.outlets if wire.waits]
        for descriptor in waiting:
            poll.register(descriptor, select.POLLOUT)
        return poll, _ROUND_MS if waiting or self._pending else None

    def _attend(self, descriptor: int) -> None:
        if descriptor == self._bell:
            os.eventfd_read(self._bell)
        elif descriptor == self._seat.fileno():
            with forks.opening:
                for connection in self._newcomers():
                    self._meet(connection, dialled=False)
                    self._thin_out()
        elif (pending := self._pending.get(descriptor)) is not None:
            self._hear(pending)

    def _newcomers(self) -> Iterator[socket.socket]:
        with contextlib.suppress(OSError):
            while True:
                yield self._seat.accept()[0]

    def _thin_out(self) -> None:
        silent = [fd for fd, pending in self._pending.items() if not pending.dialled]
        for descriptor in silent[: len(silent) - MOST_STRANGERS]:
            self._hear(self._pending[descriptor])  # it may have introduced itself meanwhile
            if pending := self._pending.pop(descriptor, None):
                pending.connection.close()

    def _hear(self, pending: PendingConnection) -> None:
        """Take the next bytes of an introduction; with the last one the stranger becomes a member."""
        try:
            data = pending.connection.recv(GREETING_BYTES - len(pending.heard))
        except BlockingIOError:
            return
        except OSError:
            data = b""
        pending.heard += data
        if data and len(pending.heard) < GREETING_BYTES:
            return
        greeting = read_greeting(pending.heard)
        del self._pending[pending.connection.fileno()]
        if (
            greeting is None
            or greeting.answer is not pending.dialled
            or greeting.channel != self._id
            or greeting.token == self._token
        ):
            self.malformed += bool(data)
            pending.connection.close()
        else:
            self._welcome(pending, greeting.token)

    def _welcome(self, pending: PendingConnection, token: int) -> None:
        wire = Wire(pending.connection, token, self._channel)
        if not pending.dialled:
            answer = Greeting(answer=True, channel=self._id, token=self._token)
            try:
                wire.put(answer.encode(), monotonic())
            except OSError:
                pending.connection.close()
                return
        self._wires[wire.descriptor] = wire
        self._count()
        self.inlet.register(wire.descriptor, select.EPOLLIN)

    def _count(self) -> None:
        """Choose the connection to send on for each member: the one that was known first."""
        chosen: dict[int, Wire] = {}
        for wire in self._wires.values():
            chosen.setdefault(wire.token, wire)
        self.outlets = tuple(chosen.values())

    def _drain(self, now: float) -> None:
        for wire in self.outlets:
            if wire.waits:
                try:
                    wire.flush(now)
                except OSError:
                    self.lose(wire)
        self._delayed = any(wire.waits for wire in self.outlets)
        for pending in list(self._pending.values()):
            if now - pending.since > MANNERS:
                del self._pending[pending.connection.fileno()]
                pending.connection.close()

    def _hang_up(self, connection: socket.socket) -> None:
        with contextlib.suppress(OSError, ValueError):
            self.inlet.unregister(connection)
        connection.close()
