"""The files, sockets and processes of the operating system, as a `System` has them (`system.py`).

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
    """The parts of a machine that a process can look at: clocks, processes, files, listeners."""

    now = staticmethod(time.monotonic)
    """Returns the time [s] on the machine's monotonic clock."""
    unix = staticmethod(time.time)
    """Returns the time [s] since 1970."""
    pid = staticmethod(os.getpid)
    user = staticmethod(os.geteuid)
    chance = staticmethod(os.urandom)
    """Returns so many random bytes."""

    # -- processes

    def lives(self, pid: int) -> bool:
        """Whether a process has not ended."""
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:  # somebody else's
            return True
        return True

    def text(self, path: Path) -> str:
        """Read what the kernel tells in a file of /proc."""
        return path.read_text(errors="surrogateescape")

    # -- files

    def private_folder(self, path: Path) -> None:
        """See that a folder is there which only this user can enter: `files.private_folder`, strict."""
        files.private_folder(path, strict=True)

    def names(self, folder: Path) -> list[str]:
        """Return the names in a folder, in no order."""
        with os.scandir(folder) as entries:
            return [entry.name for entry in entries]

    def status(self, path: Path) -> os.stat_result:
        """Return what is known of a name, which may be a link: lstat(2)."""
        return os.lstat(path)

    def opened(self, path: Path, *, writes: bool = False, makes: bool = False, empties: bool = False) -> int:
        """Open an ordinary file, never through a link: `files.opened`.

        Args:
            path: of the file.
            writes: whether it can be written, too.
            makes: whether it is made if it is not there.
            empties: whether what was in it is removed.
        """
        access = os.O_RDWR if writes else os.O_RDONLY
        access |= (os.O_CREAT if makes else 0) | (os.O_TRUNC if empties else 0)
        return files.opened(path, access | os.O_NOFOLLOW)

    def null(self) -> int:
        """Open the null device: a descriptor in reserve."""
        return os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def close(self, descriptor: int) -> None:
        """Close a file."""
        os.close(descriptor)

    def read(self, path: Path, most: int) -> bytes:
        """Read an ordinary file whole: `files.read`."""
        return files.read(path, most)

    def pread(self, descriptor: int, size: int, at: int) -> bytes:
        """Read so many bytes at a place of a file; fewer, if it ends before."""
        return os.pread(descriptor, size, at)

    def pwrite(self, descriptor: int, data: bytes, at: int) -> int:
        """Write at a place of a file; returns how much was written [bytes]."""
        return os.pwrite(descriptor, data, at)

    def append(self, descriptor: int, data: bytes) -> int:
        """Write at the end of a file; returns how much was written [bytes]."""
        os.lseek(descriptor, 0, os.SEEK_END)
        return os.write(descriptor, data)

    def rename(self, path: Path, to: Path) -> None:
        """Give a file or socket another name; what had that name is removed."""
        path.rename(to)

    def unlink(self, path: Path) -> None:
        """Remove a name."""
        path.unlink()

    # -- sockets

    def listen(self, path: Path, backlog: int) -> socket.socket:
        """Return a socket that listens under a name, and does not wait.

        Args:
            path: of the socket; it is not there yet.
            backlog: connections that may wait.
        """
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
        """Return a connection to who listens under a name.

        Args:
            path: of the socket.
            timeout: [s] of the connection, and to wait for a place in line; 0: it does not wait.

        Raises:
            ConnectionRefusedError: nobody listens there any more.
            BlockingIOError: too many connections wait.
            OSError: it cannot be connected to now.
        """
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
        """Return process and user at the far end of a connection (SO_PEERCRED, unix(7))."""
        packed = line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        process, user, _ = _CREDENTIALS.unpack(packed)
        return process, user


@contextlib.contextmanager
def short(path: Path) -> Generator[str]:
    """Give a socket's path a form that the system takes, however long it is (108 bytes, unix(7)).

    It is left as it is where that is short enough: the system remembers it, see `network/realms.py`.
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
