"""Files to which frames of bytes are appended, each with its length and a checksum, oldest file first.

    NUMBER.log    frames: length (u32), CRC-32 of the length (u32), CRC-32 of the body (u32), body
    lock          held by the host that writes: of two, the second is refused

A frame that the end of a file cuts short was never finished, so nothing has depended on it: it is left out,
also in an older file, for the process that came next may have ended before its own file was whole. Anything
else that does not fit its checksum is damage, and nothing of the log is used then; but the end of a file that
was not synced may look like that, too, when the machine has lost its power.
"""

from __future__ import annotations

import fcntl
import logging
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

from robotree.files import private_folder
from robotree.vr.base.errors import DamagedJournal, JournalInUse

HEAD = struct.Struct("<III")
"""Length of the body that follows, the checksum of these four bytes, and that of the body."""
_LENGTH = struct.Struct("<I")

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


class OSDisk:
    """The production form of `Disk`."""

    def names(self, folder: Path) -> list[str]:
        """See `Disk.names`."""
        return [path.name for path in folder.iterdir()]

    def read(self, path: Path) -> bytes:
        """See `Disk.read`."""
        return path.read_bytes()

    def create(self, path: Path) -> int:
        """See `Disk.create`."""
        return os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC, 0o600)

    def write(self, descriptor: int, data: bytes | bytearray) -> int:
        """See `Disk.write`."""
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        """See `Disk.sync`."""
        os.fdatasync(descriptor)

    def sync_folder(self, folder: Path) -> None:
        """See `Disk.sync_folder`."""
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def close(self, descriptor: int) -> None:
        """See `Disk.close`."""
        os.close(descriptor)

    def unlink(self, path: Path) -> None:
        """See `Disk.unlink`."""
        path.unlink(missing_ok=True)

    def lock(self, folder: Path) -> int:
        """See `Disk.lock`."""
        private_folder(folder)
        descriptor = os.open(folder / "lock", os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise
        return descriptor


class Segments:
    """The files of one log, in a folder of their own."""

    def __init__(self, folder: Path, disk: Disk) -> None:
        """Take the folder for this process.

        Raises:
            JournalInUse: another host has it.
            OSError: the folder cannot be made.
        """
        self.folder, self._disk = folder, disk
        try:
            self._lock = disk.lock(folder)
        except BlockingIOError:
            raise JournalInUse(folder=str(folder)) from None
        self._numbers = sorted(int(name[:-4]) for name in disk.names(folder) if name.endswith(".log"))
        self._open = -1
        self._named = False
        """Whether the name of the newest file would survive a loss of power."""
        self.size = 0
        """[bytes] of the newest file, as far as this process has written it."""

    def frames(self, lost_power: Callable[[], bool] = lambda: False) -> Iterator[bytes]:
        """Return the bodies of all frames, the oldest first.

        Args:
            lost_power: whether the machine may have lost its power since the frames before were written; then
                a file ends before the first frame that does not fit its checksum.

        Raises:
            DamagedJournal: one does not fit its checksum.
            OSError: a file cannot be read.
        """
        for number in self._numbers:
            path = self._path(number)
            try:
                yield from _frames(self._disk.read(path), str(path))
            except DamagedJournal as damage:
                if not lost_power():
                    raise
                _log.warning("what was not synced was lost with the power: %s", damage)

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
        length = len(body) - HEAD.size
        check = zlib.crc32(_LENGTH.pack(length))
        HEAD.pack_into(body, 0, length, check, zlib.crc32(memoryview(body)[HEAD.size :]))
        if self._disk.write(self._open, body) < len(body):
            raise OSError(28, "it was written in part only: the disk is full")
        self.size += len(body)

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

    def _close(self) -> None:
        descriptor, self._open = self._open, -1
        if descriptor >= 0:
            self._disk.close(descriptor)

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:08}.log"


def _frames(data: bytes, path: str) -> Iterator[bytes]:
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
