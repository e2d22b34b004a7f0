"""Files to which frames of bytes are appended, each with its length and a checksum, oldest file first.

    NUMBER.log    frames: length (u32), CRC-32 of the length (u32), CRC-32 of the body (u32), body
    lock          held by the host that writes: of two, the second is refused. It says how long the newest
                  file is, so that a file that somebody has removed or shortened is missed

A frame that the end of a file cuts short was never finished, so nothing has depended on it: it is left out,
also in an older file, for the process that came next may have ended before its own file was whole. Anything
else that does not fit its checksum is damage, and nothing of the log is used then; but the end of a file that
was not synced may look like that, too, when the machine has lost its power.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Protocol

from robotree.files import forks, opened_own, private_folder, sync_folder
from robotree.vr.base.errors import DamagedJournal, JournalInUse, LostJournal

HEAD = struct.Struct("<III")
"""Length of the body that follows, the checksum of these four bytes, and that of the body."""
_LENGTH = struct.Struct("<I")
_MARK = struct.Struct("<QQ36s")
"""Number and size of the newest file, and the boot of the machine; a CRC-32 of them follows."""
MARK_SIZE = _MARK.size + _LENGTH.size
"""[bytes] of the lock file."""
_NAME = re.compile(r"([0-9]{8,19})\.log")

_log = logging.getLogger(__name__)


class Disk(Protocol):
    """What the log needs of a file system; a simulation has another one."""

    def names(self, folder: Path) -> list[str]:
        """Return the names in a folder, in no order."""
        ...

    def read(self, path: Path) -> bytes:
        """Return a file whole."""
        ...

    def create(self, path: Path) -> int:
        """Open a new file for `write`; returns its descriptor."""
        ...

    def write(self, descriptor: int, data: bytes | bytearray) -> int:
        """Append to a file; returns how much was written [bytes]."""
        ...

    def sync(self, descriptor: int) -> None:
        """Return when what was written would survive a loss of power."""
        ...

    def sync_folder(self, folder: Path) -> None:
        """Return when the names in a folder would survive a loss of power."""
        ...

    def close(self, descriptor: int) -> None:
        """Close a file."""
        ...

    def unlink(self, path: Path) -> None:
        """Remove a file."""
        ...

    def lock(self, folder: Path) -> int:
        """Make a folder, and lock it for this process; returns the descriptor of the lock.

        Raises:
            BlockingIOError: another process has it.
        """
        ...

    def lock_anew(self, folder: Path) -> int:
        """Lock a folder whose lock a process has that was deposed; what is marked there is copied."""
        ...

    def marked(self, lock: int) -> bytes:
        """Return what `mark` has written last, also by another process; empty: nothing."""
        ...

    def mark(self, lock: int, data: bytes) -> None:
        """Replace the content of the lock file; always with as many bytes."""
        ...


class OSDisk:
    """The production form of `Disk`. A process that a page forks keeps none of its files, nor the lock."""

    def __init__(self) -> None:
        """Begin without open files."""
        self._open: dict[int, None] = {}
        forks.owns(self)

    def in_child(self) -> Iterable[int]:
        return tuple(self._open)

    def names(self, folder: Path) -> list[str]:
        return [path.name for path in folder.iterdir()]

    def read(self, path: Path) -> bytes:
        with os.fdopen(opened_own(path), "rb") as file:
            return file.read()

    def create(self, path: Path) -> int:
        with forks.opening:
            descriptor = os.open(
                path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC, 0o600
            )
            self._open[descriptor] = None
        return descriptor

    def write(self, descriptor: int, data: bytes | bytearray) -> int:
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        os.fdatasync(descriptor)

    def sync_folder(self, folder: Path) -> None:
        sync_folder(folder)

    def close(self, descriptor: int) -> None:
        with forks.opening:
            self._open.pop(descriptor, None)
            os.close(descriptor)

    def unlink(self, path: Path) -> None:
        path.unlink(missing_ok=True)

    def lock(self, folder: Path) -> int:
        private_folder(folder)
        with forks.opening:
            descriptor = opened_own(folder / "lock", os.O_CREAT | os.O_RDWR)
            self._open[descriptor] = None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.close(descriptor)
            raise
        return descriptor

    def lock_anew(self, folder: Path) -> int:
        coming, path = folder / "lock.new", folder / "lock"
        coming.unlink(missing_ok=True)
        with suppress(FileNotFoundError):
            coming.write_bytes(path.read_bytes())
            coming.chmod(0o600)
            coming.rename(path)
        return self.lock(folder)

    def marked(self, lock: int) -> bytes:
        return os.pread(lock, MARK_SIZE, 0)

    def mark(self, lock: int, data: bytes) -> None:
        os.pwrite(lock, data, 0)


class Ownership(Protocol):
    """That this process may write; see `store`."""

    def expect(self) -> None:
        """Check that this process may still write.

        Raises:
            Deposed: another host has the log.
        """
        ...

    def beat(self) -> None:
        """Give a sign of life."""
        ...

    def close(self) -> None:
        """Let go of it. Twice is once."""
        ...


class Extent(NamedTuple):
    """What the lock file says of the log."""

    number: int
    """Of the newest file; 0: there is none, for the disk took no more."""
    size: int
    """[bytes] of it."""
    boot: bytes
    """Of the machine: what was not synced is lost with it."""

    def packed(self) -> bytes:
        """Return its content."""
        content = _MARK.pack(*self)
        return content + _LENGTH.pack(zlib.crc32(content))

    @classmethod
    def read(cls, data: bytes) -> Extent | None:
        """Read it; None: it was never written, or not to its end."""
        content = data[: _MARK.size]
        whole = len(data) == MARK_SIZE and data[_MARK.size :] == _LENGTH.pack(zlib.crc32(content))
        return cls(*_MARK.unpack(content)) if whole else None


class Segments:
    """The files of one log, in a folder of their own. `LogStore`."""

    def __init__(self, folder: Path, disk: Disk, boot: str = "", owner: Ownership | None = None) -> None:
        """Take the folder for this process.

        Args:
            folder: of the log.
            disk: where the folder is.
            boot: of the machine, 36 characters; empty: unknown.
            owner: that this process is the owner, whoever holds the lock; None: the lock decides.

        Raises:
            JournalInUse: another host has it.
            OSError: the folder cannot be made.
        """
        self._open = -1
        self.folder, self.where, self.name = folder, str(folder), folder.name
        self._disk, self._boot = disk, boot.encode()[:36].ljust(36, b"\0")
        self._owner = owner
        try:
            self._lock = disk.lock(folder)
        except BlockingIOError:
            if owner is None:
                raise JournalInUse(folder=str(folder), host=folder.name) from None
            self._lock = disk.lock_anew(folder)
        self._named = False
        """Whether the name of the newest file would survive a loss of power."""
        try:
            self._before = Extent.read(disk.marked(self._lock))
            self._numbers = self._there()
        except BaseException:
            self.close()
            raise
        self.size = 0
        """[bytes] of the newest file, as far as this process has written it."""
        self.missing = ""
        """What is not there, though it was written; a clause. Empty: all is."""

    def frames(self, lost_power: Callable[[], bool] = lambda: False) -> Iterator[bytes]:
        """Return the bodies of all frames, the oldest first.

        Args:
            lost_power: whether the machine may have lost its power since the frames before were written; then
                a file ends before the first frame that does not fit its checksum.

        Raises:
            DamagedJournal: one does not fit its checksum.
            LostJournal: what was written is not there any more, and the machine has run on since.
            OSError: a file cannot be read.
        """
        whole = 0, 0
        for number, data in self._read():
            path = self._path(number)
            try:
                for frame in frames_in(data, str(path)):
                    whole = number, len(data)
                    yield frame
            except DamagedJournal as damage:
                if (self._runs_on and number >= self._newest) or not lost_power():
                    raise
                _log.warning("what was not synced was lost with the power: %s", damage)
        self._expect(*whole)

    def _read(self) -> Iterator[tuple[int, bytes]]:
        """Return all files, the oldest first; an owner that was deposed may just have begun another one."""
        while True:
            self._numbers = self._there()
            try:
                found = [(number, self._disk.read(self._path(number))) for number in self._numbers]
            except FileNotFoundError:
                if self._owner is None:
                    raise
            else:
                yield from found
                return

    def _there(self) -> list[int]:
        names = map(_NAME.fullmatch, self._disk.names(self.folder))
        return sorted(int(name[1]) for name in names if name)

    def _expect(self, number: int, size: int) -> None:
        """Miss what was there when the last host wrote; a machine that lost its power may have lost it, too.

        Raises:
            LostJournal: it has not.
        """
        before = self._before
        if before is None or (number, size) >= before[:2]:
            return
        path = self._path(before.number).name
        lost = before.size - size if number == before.number else 0
        self.missing = f"{lost} bytes at the end of {path} are missing" if lost else f"{path} is missing"
        if self._runs_on:
            raise LostJournal(folder=str(self.folder), missing=self.missing)

    @property
    def _runs_on(self) -> bool:
        """Whether the machine is known to have run on since the last host wrote."""
        before = self._before
        return before is not None and before.boot == self._boot and bool(self._boot.strip(b"\0"))

    @property
    def _newest(self) -> int:
        """Number of the file that the last host wrote; those before it are of hosts that came before."""
        return 0 if self._before is None else self._before.number

    @property
    def was_full(self) -> bool:
        """Whether the last host kept nothing when it ended, for the disk took no more."""
        return self._before is not None and not self._before.number

    def begin(self) -> None:
        """Write to a new file from now on."""
        number = self._numbers[-1] + 1 if self._numbers else 1
        descriptor = self._disk.create(self._path(number))
        self._close()
        self._numbers.append(number)
        self._open, self.size, self._named = descriptor, 0, False

    def write(self, body: bytearray) -> None:
        """Append a frame, whose head is the first bytes of `body`, to be filled in here.

        Raises:
            OSError: it cannot be written whole.
        """
        seal_frame(body)
        if self._disk.write(self._open, body) < len(body):
            raise OSError(errno.ENOSPC, "it was written in part only: the disk is full")
        self.size += len(body)
        self._disk.mark(self._lock, Extent(self._numbers[-1], self.size, self._boot).packed())

    def sync(self) -> None:
        """Return when all that was written would survive a loss of power."""
        self._disk.sync(self._open)
        if not self._named:
            self._disk.sync_folder(self.folder)
            self._named = True

    def drop_older(self) -> None:
        """Remove all files but the newest."""
        for number in self._numbers[:-1]:
            self._disk.unlink(self._path(number))
        self._numbers = self._numbers[-1:]

    def clear(self) -> None:
        """Remove all files: nothing is kept any more, also after a loss of power."""
        self._close()
        with suppress(OSError):  # else the next host misses the files
            self._disk.mark(self._lock, Extent(0, 0, self._boot).packed())
        for number in self._numbers:
            self._disk.unlink(self._path(number))
        self._numbers = []
        self._disk.sync_folder(self.folder)

    def close(self) -> None:
        """Leave the folder to others. Twice is once."""
        self._close()
        lock, self._lock = self._lock, -1
        if lock >= 0:
            self._disk.close(lock)
        if self._owner is not None:
            self._owner.close()

    def expect_owner(self) -> None:
        if self._owner is not None:
            self._owner.expect()

    def beat(self) -> None:
        if self._owner is not None:
            self._owner.beat()

    def _close(self) -> None:
        descriptor, self._open = self._open, -1
        if descriptor >= 0:
            self._disk.close(descriptor)

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:08}.log"


def is_locked(descriptor: int) -> bool:
    """Whether a process holds the lock of a file."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def seal_frame(frame: bytearray) -> None:
    """Fill in the head of a frame."""
    length = len(frame) - HEAD.size
    check = zlib.crc32(_LENGTH.pack(length))
    HEAD.pack_into(frame, 0, length, check, zlib.crc32(memoryview(frame)[HEAD.size :]))


def frames_in(data: bytes, path: str) -> Iterator[bytes]:
    """Return the bodies of the frames in a segment; the last one may be cut short.

    Raises:
        DamagedJournal: one does not fit its checksum.
    """
    at, view = 0, memoryview(data)
    while at < len(data):
        begin = end = at + HEAD.size
        checksum = 0
        if begin <= len(data):
            length, check, checksum = HEAD.unpack_from(data, at)
            if zlib.crc32(_LENGTH.pack(length)) != check:
                raise DamagedJournal(path=path, at=at, detail="that is no length of a record")
            end = begin + length
        if end > len(data):
            return  # the end of the process has cut it short
        if zlib.crc32(view[begin:end]) != checksum:
            raise DamagedJournal(path=path, at=at, detail="its checksum is another one")
        yield data[begin:end]
        at = end
