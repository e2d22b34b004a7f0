"""The owner of a log in a folder: the file with the highest number.

    NUMBER.owner   the name of the host; locked (flock) as long as its process lives, touched while it works

Such a file comes with a lock and under a name that nobody had, in one step (link(2)), so one of several gets
the number. It then removes those before, and an owner whose file has no name any more has been deposed. A
lock alone would not do: a process that is paused keeps it.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

from robotree.files import forks, opened_own, private_folder
from robotree.vr.base.chance import token
from robotree.vr.base.errors import Deposed
from robotree.vr.journal.segments import Disk, OSDisk, Segments, is_locked
from robotree.vr.journal.store import Owner

_SUFFIX = ".owner"
_OWNER = re.compile(rf"([1-9][0-9]{{0,18}}){re.escape(_SUFFIX)}")
_FLAGS = os.O_NOFOLLOW | os.O_CLOEXEC


class FilePlace:
    """A folder for a log. `LogPlace`."""

    def __init__(self, folder: Path, disk: Disk | None = None, boot: str = "") -> None:
        """Take the folder; it is made when somebody becomes the owner.

        Args:
            folder: of the log.
            disk: where it is; None: the operating system's.
            boot: of the machine; empty: unknown.
        """
        self.folder, self.where, self._boot = folder, str(folder), boot
        self._disk = OSDisk() if disk is None else disk

    def look(self) -> Owner | None:
        while numbers := self._numbers():
            with suppress(FileNotFoundError):  # it has just been deposed
                return self._seen(numbers[-1])
        return None

    def _seen(self, number: int) -> Owner:
        with os.fdopen(opened_own(self._path(number)), "rb") as file:
            lives = is_locked(file.fileno())
            host, beat = file.read(1000).decode(errors="replace"), os.fstat(file.fileno()).st_mtime_ns
        return Owner(number, host, beat, lives)

    def take(self, host: str, after: int) -> Segments | None:
        private_folder(self.folder)
        with forks.opening:  # until the owner's file knows its descriptor
            return self._take(host, after)

    def _take(self, host: str, after: int) -> Segments | None:
        if (self._numbers() or [0])[-1] != after:
            return None
        path, coming = self._path(after + 1), self.folder / f"{token()}.new"
        descriptor = os.open(coming, os.O_CREAT | os.O_EXCL | os.O_RDWR | _FLAGS, 0o600)
        with ExitStack() as stack:
            stack.callback(os.close, descriptor)
            try:
                os.write(descriptor, host.encode())
                fcntl.flock(descriptor, fcntl.LOCK_EX)
                os.link(coming, path)
            except FileExistsError:
                return None
            finally:
                coming.unlink(missing_ok=True)
            if self._numbers()[-1] != after + 1:  # it was there and has been deposed before we looked
                path.unlink(missing_ok=True)
                return None
            for number in self._numbers():
                if number <= after:
                    self._path(number).unlink(missing_ok=True)
            found = Segments(self.folder, self._disk, self._boot, OwnerFile(descriptor, self))
            stack.pop_all()
            return found

    def close(self) -> None:
        """See `LogPlace.close`."""

    def _numbers(self) -> list[int]:
        try:
            names = [_OWNER.fullmatch(path.name) for path in self.folder.iterdir()]
        except FileNotFoundError:
            return []
        return sorted(int(name[1]) for name in names if name)

    def _path(self, number: int) -> Path:
        return self.folder / f"{number}{_SUFFIX}"


class OwnerFile:
    """The file of this process, which no process that a page forks keeps. `segments.Ownership`."""

    def __init__(self, descriptor: int, place: FilePlace) -> None:
        """Take the file, locked."""
        self._descriptor, self._place = descriptor, place
        forks.owns(self)

    def in_child(self) -> Iterable[int]:
        return (self._descriptor,)

    def expect(self) -> None:
        descriptor = self._descriptor
        if descriptor >= 0 and not os.fstat(descriptor).st_nlink:
            owner = self._place.look()
            raise Deposed(host="somebody else" if owner is None else owner.host, log=self._place.where)

    def beat(self) -> None:
        if self._descriptor >= 0:
            os.pwrite(self._descriptor, os.pread(self._descriptor, 1, 0), 0)  # a robot apart may set no times
        self.expect()

    def close(self) -> None:
        """Let go of it. Twice is once."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)
