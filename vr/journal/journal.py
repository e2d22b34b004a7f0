"""The journal of a host: what its robots were told is written before anything that follows leaves it.

*Output commit*: `append` only fills a buffer. `barrier` writes it, and `Outlet` calls that before any byte
leaves the process: a request, a reply, a published state. What nobody outside has seen may be lost by a
crash: it is done again. What is written survives the process. After `sync` it survives a loss of power: a
command waits for that before it asks another process for something that adds up (`effect="once"`), so that
the next process knows of it, whatever else of the log was lost.

A disk that takes nothing more must not keep robots from being stopped: then the journal removes itself, for
an old one would repeat what was done since, and begins anew with the whole state when there is room again.
Where not even that can be done, the process ends at once: what it has told nobody is not known to anybody.
"""

from __future__ import annotations

import errno
import logging
import os
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Protocol

import msgspec

from robotree.vr.base.errors import CopiedJournal, JournalError, JournalUnusable
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import RobotCore, RobotState
from robotree.vr.core.transfer import Destination
from robotree.vr.journal.records import (
    VERSION,
    Began,
    CameApart,
    CameHere,
    Deleted,
    Happened,
    KeptPage,
    LogRecord,
    Made,
    MovedBack,
    MovedOut,
    NeverTaken,
    PageOffered,
    StateKept,
    Transfers,
    Whole,
    encoder,
)
from robotree.vr.journal.recovery import Recovered
from robotree.vr.journal.segments import HEAD, Disk, OSDisk, Segments
from robotree.vr.journal.store import LogStore

FULL = 64 * 1024
"""[bytes] that are written though nobody waits for them."""
LONG = 8 * 1024 * 1024
"""[bytes] of a segment after which a new one begins, with the states as they are then."""
AGAIN = 10.0
"""[s] after which a disk that was full is tried again."""

_ARRAY = b"\xdd"
"""MessagePack's array whose length is a u32."""
_EMPTY = bytes(HEAD.size) + _ARRAY + bytes(4)


class Clocks(Protocol):
    """The clocks and locks of the process: a `running.runner.Runner`."""

    def now(self) -> float:
        """Return the time [s] on a monotonic clock."""
        ...

    def unix(self) -> float:
        """Return the time [s] since 1970."""
        ...

    def lock(self) -> AbstractContextManager[object]:
        """Make a lock."""
        ...


LookAtState = Callable[[Callable[[RobotState], None]], None]
"""Hands the state of a robot to a function, while nothing changes it."""

_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Errors of a disk that takes no more, and of a user who may write no more."""

_log = logging.getLogger(__name__)


@contextmanager
def explained(where: Path | str) -> Generator[None]:
    """Have an error of the operating system say what a person can do."""
    try:
        yield
    except ConnectionError:  # of a database, which says so itself
        raise
    except OSError as error:
        full = error.errno in _FULL
        remedy = "make room on that disk" if full else "move away what is there, or make it yours"
        path, reason = error.filename or str(where), error.strerror or str(error)
        reason = f"{reason[:1].lower()}{reason[1:]}"
        raise JournalUnusable(path=path, reason=reason, remedy=remedy) from None


class HostJournal:
    """See the module. It is a `running.process.Journal`; every method may be called from any thread."""

    def __init__(
        self,
        log: LogStore | Path,
        clocks: Clocks,
        *,
        boot: str = "",
        disk: Disk | None = None,
        machine_of: Callable[[RobotState], RobotCore] = RobotCore,
    ) -> None:
        """Take a log, and read what is in it.

        Args:
            log: of which this process is the owner; or a folder, which only one process may use.
            clocks: of the process.
            boot: of the machine: monotonic moments hold within one.
            disk: where the folder is; None: the operating system's.
            machine_of: makes the machine that takes again what a robot took.

        Raises:
            JournalError: another host has it, it cannot be read, a part of it is missing, or it is that of
                another host or version; each has its class in `base.errors`.
        """
        self._clocks, self._boot = clocks, boot
        self.found = Recovered(machine_of)
        with explained(log if isinstance(log, Path) else log.where):
            if isinstance(log, Path):
                log = Segments(log, OSDisk() if disk is None else disk, boot)
            self._segments, self._host = log, log.name
            self._read()
        before = self.found.began
        self.life = 1 if before is None else before.life + 1
        """How often a host has begun with this log."""
        self._buffer, self._count = bytearray(_EMPTY), 0
        self._lock, self._writing, self._syncing = clocks.lock(), clocks.lock(), clocks.lock()
        self._busy = False
        self._appended = self._written = self._synced = 0
        """How many records there were, how many of them are written, and how many survive a loss of power."""
        self._held = False
        """Whether the file is being synchronised: it stays the newest one meanwhile."""
        self._numbers: dict[str, int] = {}
        self._last_number = 0
        self._made: dict[str, Made] = {}
        self._looks: dict[str, LookAtState] = {}
        self._offers: dict[str, KeptPage] = {}
        self._outs: dict[str, MovedOut] = {}
        """The robots that are on their way to other hosts, by key."""
        self.destination = Destination(self.found.taken, self.found.never)
        """What became of the robots that were to come here."""
        self._sealed, self._unfit, self._retry_at = False, "", 0.0
        self.suspended = ""
        """Why nothing is kept at the moment; empty: all is."""
        self.end_process: Callable[[], object] = partial(os._exit, os.EX_IOERR)
        """Ends the process at once, when its log can neither be written nor removed."""
        self.on_lost: Callable[[JournalError], None] = lambda _: None
        """Told that another host has the log, or nobody knows; nothing leaves this process any more."""

    def _read(self) -> None:
        """Read what is in the log, or leave it to others."""
        try:
            self.found.read(self._segments.frames(self._may_have_lost_power), self.where)
            self._expect_own()
        except BaseException:
            self._segments.close()
            raise

    def _expect_own(self) -> None:
        """Refuse the log of another host, and tell what is not there of the own one.

        Raises:
            CopiedJournal: the folder is a copy.
        """
        began, where = self.found.began, self.where
        if began is not None and began.host not in {"", self._host}:
            raise CopiedJournal(folder=where, other=began.host)
        if began is not None and self.shift and self._clocks.unix() < began.unix:
            _log.warning("the clock of this machine was set back since %s was written", self.where)
        if self._segments.missing:
            _log.warning("%s: the machine has ended, and %s", where, self._segments.missing)
        if self._segments.was_full:
            _log.warning("%s: the robots of the last host are not back: the disk was full", where)

    @property
    def shift(self) -> float:
        """[s] by which moments that were kept are later on the present monotonic clock.

        What has happened is over, also where the clock of the machine was set back since.
        """
        began = self.found.began
        if began is None or (began.boot == self._boot and self._boot):
            return 0.0
        now, latest = self._clocks.now(), max(self.found.latest, began.now)
        return min((began.unix - began.now) - (self._clocks.unix() - now), now - latest)

    def _may_have_lost_power(self) -> bool:
        """Whether what has been found so far was written before the machine was started."""
        began = self.found.began
        return bool(self._boot) and (began is None or began.boot != self._boot)

    @property
    def where(self) -> str:
        """Where the log is, for people."""
        return self._segments.where

    @property
    def name(self) -> str:
        """Name of the log, wherever its host runs."""
        return self._host

    @property
    def size(self) -> int:
        """[bytes] of the newest file."""
        return self._segments.size

    @property
    def trouble(self) -> str:
        """Why nothing is kept at the moment, and what a person can do; empty: all is kept."""
        if not self.suspended:
            return ""
        return f"its robots would not survive its end now ({self.suspended}); make room on that disk"

    def begin(self) -> None:
        """Begin a segment with all robots that are here, and forget the older ones.

        Raises:
            JournalUnusable: it cannot be written.
        """
        with self._writing, explained(self.where):
            self._begin()

    def _begin(self) -> None:
        """Under `_writing`."""
        with self._lock:
            self._buffer, self._count = bytearray(_EMPTY), 0
        self._segments.begin()
        self._put(Began(VERSION, self.life, self._boot, self._clocks.unix(), self._clocks.now(), self._host))
        for made in list(self._made.values()):
            self._put(made)
            look = self._looks.get(made.key)
            if look is not None:
                look(partial(self._enter, made.robot))
            if made.key in self._offers:
                self._put(PageOffered(made.robot, self._offers[made.key]))
            if made.key in self._outs:
                self._put(msgspec.structs.replace(self._outs[made.key], robot=made.robot))
        if self.destination.taken or self.destination.never:
            self._put(Transfers(tuple(self.destination.taken), tuple(self.destination.never)))
        self._put(Whole())
        self._flush()
        self._segments.sync()
        self._segments.drop_older()
        self._synced = self._written
        self.suspended = ""

    # -- what a robot's runtime tells -------------------------------------------------------------

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        number = self._numbers.get(robot)
        if number is not None:
            self._put(Happened(number, now, event))

    def commit(self) -> None:
        """Wait for nothing: `Outlet` does, before anything leaves the process."""
        if len(self._buffer) > FULL:
            self.barrier()

    # -- what the host tells ----------------------------------------------------------------------

    def made(self, key: str, name: str, page: KeptPage, look: LookAtState) -> None:
        """Take in a robot that was made; its events count from now on.

        Args:
            key: of its address.
            name: of the robot.
            page: its source.
            look: hands its state on.
        """
        self._last_number += 1
        made = Made(self._last_number, key, name, page)
        self._made[key], self._looks[key] = made, look
        self._put(made)

        def enter(state: RobotState) -> None:
            self._numbers[key] = made.robot
            self._enter(made.robot, state)

        look(enter)

    def _enter(self, number: int, state: RobotState) -> None:
        self._put(StateKept(number, state))

    def offered(self, key: str, page: KeptPage) -> None:
        """Take the page with which a robot is to go on; it counts when `PageReloaded` follows."""
        if key in self._made:
            self._offers[key] = page
            self._put(PageOffered(self._numbers[key], page))

    def turned(self, key: str, page: KeptPage) -> None:
        """Take note that a robot goes on with the page that was offered."""
        self._offers.pop(key, None)
        if key in self._made:
            before = self._made[key]
            self._made[key] = Made(before.robot, key, before.name, page)

    def out(self, key: str, transfer: str, host: str, log: str, secret: str) -> None:
        """Take note that a robot is on its way to another host; see `MovedOut`."""
        number = self._numbers.get(key)
        if number is not None:
            self._outs[key] = MovedOut(number, transfer, host, log, secret)
            self._put(self._outs[key])

    def still_out(self, key: str, out: MovedOut) -> None:
        """Carry over from an earlier life that a robot is on its way."""
        self._outs[key] = out

    def back(self, key: str) -> None:
        """Take note that a robot has not moved."""
        number = self._numbers.get(key)
        if self._outs.pop(key, None) is not None and number is not None:
            self._put(MovedBack(number))

    def arrived(self, key: str, name: str, page: KeptPage, transfer: str, state: RobotState) -> None:
        """Take in a robot that comes from another host; its events count from now on."""
        self._last_number += 1
        made = Made(self._last_number, key, name, page)
        self._made[key], self._numbers[key] = made, made.robot
        self._looks[key] = lambda take: take(state)
        self._put(CameHere(made.robot, key, name, page, transfer, state, self._clocks.now()))

    def came_apart(self, transfer: str) -> None:
        """Take note that a robot has come that lives in a process of its own, and lies in its folder."""
        self._put(CameApart(transfer))

    def looks(self, key: str, look: LookAtState) -> None:
        """Take who hands the state of a robot on that has come."""
        self._looks[key] = look

    def never(self, transfer: str) -> None:
        """Take note that a robot that was to come never does under this transfer."""
        self._put(NeverTaken(transfer))

    def page_of(self, key: str) -> KeptPage | None:
        """Return the page of a robot; None: it is not here."""
        return None if key not in self._made else self._made[key].page

    def gone(self, key: str) -> None:
        """Take note that a robot was deleted, or has moved."""
        number = self._numbers.pop(key, None)
        self._outs.pop(key, None)
        self._made.pop(key, None)
        self._looks.pop(key, None)
        if number is not None:
            self._put(Deleted(number))

    # -- writing ----------------------------------------------------------------------------------

    def barrier(self) -> None:
        """Return when all that was appended would survive the process, and this host still has its robots.

        Raises:
            Deposed: it has not.
        """
        if self._count or self._busy or self._unfit or self.suspended:
            with self._writing:
                self._write()
        self._ours(self._segments.expect_owner)

    def beat(self) -> None:
        """Show those who stand by that this host lives.

        Raises:
            Deposed: one of them has taken over.
        """
        self._ours(self._segments.beat)

    def _ours(self, work: Callable[[], None]) -> None:
        """Do something that only the owner of the log can."""
        try:
            work()
        except JournalError as error:
            self.on_lost(error)
            raise

    def sync(self) -> None:
        """Return when all that was appended would survive a loss of power.

        Those that come meanwhile share the next one. Others go on writing.
        """
        own = self._appended
        with self._syncing:
            if self._synced >= own:
                return
            with self._writing:
                self._write()
                if self.suspended or self._sealed:
                    return
                written, self._held = self._written, True
            trouble: OSError | None = None
            try:
                self._segments.sync()
            except OSError as error:
                trouble = error
            with self._writing:
                self._held = False
                if trouble is None:
                    self._synced = max(self._synced, written)
                elif not (self.suspended or self._sealed):
                    self._suspend(trouble)

    def seal(self) -> None:
        """Write nothing more: what happens from now on belongs to the end of this process."""
        with self._writing:
            self._write()
            self._sealed = True

    def close(self) -> None:
        """Leave the log to the next host. Twice is once."""
        self.seal()
        self._segments.close()

    def _put(self, record: LogRecord) -> None:
        with self._lock:
            size = len(self._buffer)
            try:
                encoder.encode_into(record, self._buffer, -1)
            except (TypeError, ValueError, OverflowError) as error:  # it must not be left out in silence
                del self._buffer[size:]
                self._unfit = f"{type(record).__name__} cannot be written: {error}"
            else:
                self._count += 1
                self._appended += 1

    def _write(self) -> None:
        """Write what was appended. Under `_writing`."""
        if self._sealed:
            with self._lock:
                self._buffer, self._count = bytearray(_EMPTY), 0
            return
        if self._unfit:
            reason, self._unfit = self._unfit, ""
            self._suspend(OSError(reason))
        if self.suspended:
            self._resume()
            return
        self._attempt(self._flush)
        if self._segments.size > LONG and not (self.suspended or self._held):
            self._attempt(self._begin)

    def _flush(self) -> None:
        with self._lock:
            if not self._count:
                return
            self._busy = True
            body, count, upto = self._buffer, self._count, self._appended
            self._buffer, self._count = bytearray(_EMPTY), 0
        try:
            body[HEAD.size + 1 : len(_EMPTY)] = count.to_bytes(4, "big")
            self._segments.write(body)
            self._written = upto
        finally:
            self._busy = False

    # -- a disk that takes nothing ----------------------------------------------------------------

    def _attempt(self, work: Callable[[], None]) -> None:
        try:
            self._ours(work)
        except OSError as error:
            self._suspend(error)

    def _suspend(self, error: OSError) -> None:
        """Keep nothing: what is on the disk is not true any more."""
        self.suspended = error.strerror or str(error)
        self._retry_at = self._clocks.now() + AGAIN
        self._clear()
        _log.error("%s: %s", self.where, self.trouble)

    def _clear(self) -> None:
        """Remove the log, or end before it is untrue: the next host would believe it and do things twice."""
        try:
            self._ours(self._segments.clear)
        except OSError as error:
            _log.critical("%s can neither be written nor removed: this host ends (%s)", self.where, error)
            self.end_process()

    def _resume(self) -> None:
        with self._lock:
            self._buffer, self._count = bytearray(_EMPTY), 0
        if self._clocks.now() < self._retry_at:
            return
        try:
            self._ours(self._begin)
        except OSError as error:
            self.suspended = error.strerror or str(error)
            self._retry_at = self._clocks.now() + AGAIN
            self._clear()
        else:
            _log.warning("%s: the robots are kept again", self.where)
