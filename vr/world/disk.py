"""A disk in memory, for journals: what a process has written outlives it, what was synced outlives the power.

    medium = Medium()
    disk = MemoryDisk(medium)                                  # as one process sees it
    journal = HostJournal(folder, LogClocks(runner), disk=disk)
    disk.end()                                                 # the process is killed: its locks are free
    medium.lose_power(chance)                                  # and so was the machine

What was not synced is lost or torn with the power, file by file: it stops anywhere, or sectors of it read as
zeros. So is what was done to names in a folder that was not synced: a file that was made may be gone, one
that was removed may be back.
"""

from __future__ import annotations

import errno
import itertools
import os
import random
from collections.abc import Callable
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import NoReturn

from robotree.vr.world.virtual_runner import VirtualLock, VirtualProcess, VirtualRunner

SECTOR = 512
"""[bytes] that a disk writes wholly or not at all."""

Moment = Callable[[str], object]
"""Called at each moment at which a process may end, with its name: `before write`, `after sync`, …"""


def fail(number: int, name: object = None) -> NoReturn:
    """Raise what the system call would."""
    raise OSError(number, os.strerror(number), None if name is None else str(name))


@dataclass
class _Content:
    """The content of a file."""

    data: bytearray = field(default_factory=bytearray)
    synced: int = 0
    """[bytes] at its beginning that outlive the power."""


@dataclass
class _Folder:
    """Names, as processes see them, and those that outlive the power."""

    names: dict[str, _Content] = field(default_factory=dict[str, _Content])
    synced: dict[str, _Content] = field(default_factory=dict[str, _Content])
    mark: bytes = b""
    """In the lock file; after a loss of power a host only tells what it misses."""
    synced_mark: bytes = b""


class Medium:
    """The disk itself, which processes share and outlive."""

    def __init__(self) -> None:
        """Begin empty."""
        self.folders: dict[str, _Folder] = {}
        self.room = inf
        """[bytes] that can still be written, also into new files; a file that is removed gives none back."""
        self.broken = False
        """Whether nothing at all can be written, synced or removed: the disk has become read-only."""
        self.locks: dict[str, MemoryDisk] = {}
        """The holder of the lock of each folder."""

    def lose_power(self, chance: random.Random) -> None:
        """Lose what was not synced, or a part of it; all processes must have ended before."""
        for folder in self.folders.values():
            touched = folder.names.keys() | folder.synced.keys()
            for name in sorted(touched):
                before, after = folder.synced.get(name), folder.names.get(name)
                kept = after if before is after or chance.random() < 0.5 else before
                folder.names.pop(name, None)
                if kept is not None:
                    folder.names[name] = kept
                    _tear(kept, chance)
            folder.synced = dict(folder.names)
            folder.mark = chance.choice([folder.mark, folder.synced_mark])

    def copy(self) -> dict[str, _Folder]:
        """Return all that is on it, for `put_back`."""
        return deepcopy(self.folders)

    def put_back(self, folders: dict[str, _Folder]) -> None:
        """Have it as it was once, as a person does who takes an old copy; all processes must have ended."""
        self.folders = deepcopy(folders)


def _tear(content: _Content, chance: random.Random) -> None:
    """Leave what was synced of a file, and of the rest as much as chance has it."""
    loose = content.data[content.synced :]
    del content.data[content.synced + chance.randint(0, len(loose)) :]
    if chance.random() < 0.3:
        for at in range(content.synced, len(content.data), SECTOR):
            end = min(at + SECTOR, len(content.data))
            if chance.random() < 0.3:
                content.data[at:end] = bytes(end - at)
    content.synced = len(content.data)


class MemoryDisk:
    """A medium as one process sees it: a `journal.segments.Disk`."""

    def __init__(
        self,
        medium: Medium | None = None,
        *,
        moment: Moment = lambda _: None,
        chance: Callable[[], float] = lambda: 0.5,
    ) -> None:
        """Begin with nothing open.

        Args:
            medium: where the files are; None: one of its own.
            moment: called before, within and after what is done.
            chance: where a write is divided, within which the process may end.
        """
        self.medium = Medium() if medium is None else medium
        self.moment, self._chance = moment, chance
        self._open: dict[int, _Content] = {}
        self._locks: dict[int, str] = {}
        self._numbers = itertools.count(3)

    def end(self) -> None:
        """Close all: the process has ended. Nothing that it wrote is lost."""
        self._open.clear()
        for folder in self._locks.values():
            del self.medium.locks[folder]
        self._locks.clear()

    # -- a Disk -----------------------------------------------------------------------------------

    def names(self, folder: Path) -> list[str]:
        self.moment("before names")
        return list(self._folder(folder).names)

    def read(self, path: Path) -> bytes:
        self.moment("before read")
        names = self._folder(path.parent).names
        if path.name not in names:
            fail(errno.ENOENT, path)
        return bytes(names[path.name].data)

    def create(self, path: Path) -> int:
        self.moment("before create")
        names = self._folder(path.parent).names
        self._expect_room(path)
        if path.name in names:
            fail(errno.EEXIST, path)
        names[path.name] = content = _Content()
        number = next(self._numbers)
        self._open[number] = content
        self.moment("after create")
        return number

    def write(self, descriptor: int, data: bytes | bytearray) -> int:
        """See `Disk.write`: what finds no room is left out."""
        self.moment("before write")
        content = self._content(descriptor)
        self._expect_room()
        data = bytes(data[: int(min(len(data), self.medium.room))])
        first = int(self._chance() * len(data))
        content.data += data[:first]
        self.moment("within write")
        content.data += data[first:]
        self.medium.room -= len(data)
        self.moment("after write")
        return len(data)

    def sync(self, descriptor: int) -> None:
        self.moment("before sync")
        content = self._content(descriptor)
        self._expect_whole()
        content.synced = len(content.data)
        self.moment("after sync")

    def sync_folder(self, folder: Path) -> None:
        self.moment("before sync")
        entries = self._folder(folder)
        self._expect_whole()
        entries.synced, entries.synced_mark = dict(entries.names), entries.mark
        self.moment("after sync")

    def close(self, descriptor: int) -> None:
        if descriptor in self._locks:
            del self.medium.locks[self._locks.pop(descriptor)]
        elif self._open.pop(descriptor, None) is None:
            fail(errno.EBADF)

    def unlink(self, path: Path) -> None:
        self.moment("before unlink")
        self._expect_whole(path)
        self._folder(path.parent).names.pop(path.name, None)
        self.moment("after unlink")

    def lock(self, folder: Path) -> int:
        self.moment("before lock")
        self.medium.folders.setdefault(str(folder), _Folder())
        if str(folder) in self.medium.locks:
            fail(errno.EAGAIN, folder)
        number = next(self._numbers)
        self.medium.locks[str(folder)] = self
        self._locks[number] = str(folder)
        return number

    def lock_anew(self, folder: Path) -> int:
        """See `Disk.lock_anew`: there is one process on this disk, and nobody who could be deposed."""
        return self.lock(folder)

    def marked(self, lock: int) -> bytes:
        return self.medium.folders[self._locks[lock]].mark

    def mark(self, lock: int, data: bytes) -> None:
        self.moment("before mark")
        self._expect_whole()
        self.medium.folders[self._locks[lock]].mark = data

    def _folder(self, path: Path) -> _Folder:
        if str(path) not in self.medium.folders:
            fail(errno.ENOENT, path)
        return self.medium.folders[str(path)]

    def _content(self, descriptor: int) -> _Content:
        if descriptor not in self._open:
            fail(errno.EBADF)
        return self._open[descriptor]

    def _expect_whole(self, path: Path | None = None) -> None:
        if self.medium.broken:
            fail(errno.EROFS, path)

    def _expect_room(self, path: Path | None = None) -> None:
        self._expect_whole(path)
        if self.medium.room <= 0:
            fail(errno.ENOSPC, path)


class LogClocks:
    """The clocks and locks of a simulated process, as `journal.HostJournal` takes them."""

    def __init__(self, runner: VirtualProcess | VirtualRunner) -> None:
        """Take the process."""
        self.now, self.unix = runner.now, runner.unix
        self._runner = runner.runner if isinstance(runner, VirtualProcess) else runner

    def lock(self) -> AbstractContextManager[object]:
        """Make a lock that may be waited for while the lock of a robot is held."""
        return VirtualLock(self._runner, inner=True)
