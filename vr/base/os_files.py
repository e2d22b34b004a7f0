"""The files, sockets and processes of the operating system, in the words of `System` (`system.py`).

It imports little, so that a stop can begin here before anything else is loaded (`network/lean_stop.py`).
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import time
from collections.abc import Generator
from pathlib import Path

from robotree import files

READABLE = select.EPOLLIN
"""Something has come, a connection waits, or the far end has closed."""
WRITABLE = select.EPOLLOUT
CLOSED_THERE = select.EPOLLRDHUP
"""The far end sends no more."""
HUNG_UP = select.EPOLLHUP
"""Neither end sends any more."""
FAILED = select.EPOLLERR
"""Something was lost."""
ENDED = CLOSED_THERE | HUNG_UP | FAILED
"""Events of a socket whose far end has closed. They come once, perhaps together with what was sent before."""
ON_CHANGE = select.EPOLLET
"""Report what is ready once, when it becomes ready."""

AT_ONCE = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
"""Flags of `send`: never wait, and raise where nobody listens."""

BOTH_WAYS = socket.SHUT_RDWR
"""Ends both directions of a connection (`shutdown`)."""

LONGEST_PATH = 108
"""[bytes] of a socket's path, with a final zero (sun_path, unix(7))."""

_TIMEVAL = struct.Struct("@ll")
"""Seconds and microseconds (struct timeval, socket(7))."""

_CREDENTIALS = struct.Struct("3i")


class OSFiles:
    """See `system.Files`, where each method is described."""

    now = staticmethod(time.monotonic)
    unix = staticmethod(time.time)
    pid = staticmethod(os.getpid)
    user = staticmethod(os.geteuid)
    chance = staticmethod(os.urandom)

    # -- processes

    def lives(self, pid: int) -> bool:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:  # somebody else's
            return True
        return True

    def text(self, path: Path) -> str:
        return path.read_text(errors="surrogateescape")

    # -- files

    def private_folder(self, path: Path) -> None:
        files.private_folder(path, strict=True)

    def names(self, folder: Path) -> list[str]:
        with os.scandir(folder) as entries:
            return [entry.name for entry in entries]

    def status(self, path: Path) -> os.stat_result:
        return os.lstat(path)

    def opened(self, path: Path, *, writes: bool = False, makes: bool = False, empties: bool = False) -> int:
        access = os.O_RDWR if writes else os.O_RDONLY
        access |= (os.O_CREAT if makes else 0) | (os.O_TRUNC if empties else 0)
        return files.opened(path, access | os.O_NOFOLLOW)

    def null(self) -> int:
        return os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def close(self, descriptor: int) -> None:
        os.close(descriptor)

    def read(self, path: Path, most: int) -> bytes:
        return files.read(path, most)

    def pread(self, descriptor: int, size: int, at: int) -> bytes:
        return os.pread(descriptor, size, at)

    def pwrite(self, descriptor: int, data: bytes, at: int) -> int:
        return os.pwrite(descriptor, data, at)

    def append(self, descriptor: int, data: bytes) -> int:
        os.lseek(descriptor, 0, os.SEEK_END)
        return os.write(descriptor, data)

    def rename(self, path: Path, to: Path) -> None:
        path.rename(to)

    def unlink(self, path: Path) -> None:
        path.unlink()

    # -- sockets

    def listen(self, path: Path, backlog: int) -> socket.socket:
        door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            door.setblocking(False)
            with short(path) as name:
                door.bind(name)
            path.chmod(0o600)  # nobody else gets into the folder; a second lock costs nothing
            door.listen(backlog)
        except BaseException:
            door.close()
            raise
        return door

    def dial(self, path: Path, timeout: float = 0.0) -> socket.socket:
        line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            line.settimeout(None if timeout else 0.0)
            if timeout:  # of `connect` only the kernel can limit how long it waits for a place (unix(7))
                seconds = int(timeout)
                limit = _TIMEVAL.pack(seconds, int((timeout - seconds) * 1e6))
                line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
            with short(path) as name:
                line.connect(name)
            line.settimeout(timeout)
        except BaseException:
            line.close()
            raise
        return line

    def far_end(self, line: socket.socket) -> tuple[int, int]:
        packed = line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        process, user, _ = _CREDENTIALS.unpack(packed)
        return process, user


@contextlib.contextmanager
def short(path: Path) -> Generator[str]:
    """Give a socket's path a form that the system takes, however long it is (108 bytes, unix(7)).

    It is left as it is where that is short enough: the system remembers it, see `network/living.py`.
    """
    if len(os.fsencode(path)) < LONGEST_PATH:
        yield str(path)
        return
    folder = os.open(path.parent, os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


OS_FILES = OSFiles()
