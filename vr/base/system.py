"""The interface of the machine for the network of a process, and nothing more.

`OS` is the production form, as thin as can be: what is called often is the operating system's own function.
`tests/world/machine.py` is the other form: a machine in virtual time with faults from a seed. Code that
takes these things from a `System` runs unchanged in both. `tests/vr/world/test_system_contract.py` holds one
against the other. `running/runner.py` is the same for the code of robots.
"""

from __future__ import annotations

import atexit
import os
import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from robotree.files import forks
from robotree.vr.base.os_files import OSFiles

LOOKS = 5
"""How often two clocks are compared: a process may be interrupted between a look at one and at the other."""


def clock_shift(now: Callable[[], float], unix: Callable[[], float]) -> float:
    """Return by how much the clock of the day is ahead of a monotonic one [s], however busy the machine is.

    Of several looks the quickest counts, as in NTP's clock filter (RFC 5905, section 10).

    Args:
        now: returns the time [s] on the monotonic clock.
        unix: returns the time [s] since 1970.
    """

    def look() -> tuple[float, float]:
        before, day, after = now(), unix(), now()
        return after - before, day - (before + after) / 2

    return min(look() for _ in range(LOOKS))[1]


class Socket(Protocol):
    """A Unix stream socket that never waits, as `socket.socket` has it."""

    def fileno(self) -> int:
        """Return its descriptor; -1: it is closed."""
        ...

    def setblocking(self, flag: bool, /) -> None:  # noqa: FBT001 # as `socket.socket`
        """Choose whether it waits; only False is used after `dial`."""
        ...

    def getpeername(self) -> Any:
        """Return the name under which the socket was made that this one was connected to."""
        ...

    def send(self, data: Any, flags: int = 0, /) -> int:
        """Send as much as there is room for (`os_files.AT_ONCE`); returns how much that was [bytes].

        Raises:
            BlockingIOError: there is no room.
            OSError: the far end is closed.
        """
        ...

    def recv(self, size: int, /) -> bytes:
        """Take what has come; nothing: the far end is closed.

        Raises:
            BlockingIOError: nothing has come.
            OSError: the far end is closed, and something was lost.
        """
        ...

    def accept(self) -> tuple[Socket, Any]:
        """Return the connection that has waited longest, and its name.

        Raises:
            BlockingIOError: none waits.
            OSError: there is no free descriptor.
        """
        ...

    def shutdown(self, how: int, /) -> None:
        """End both directions; the descriptor stays open."""
        ...

    def close(self) -> None:
        """Close it. Twice is once."""
        ...

    def settimeout(self, seconds: float | None, /) -> None:
        """Choose how long it waits at most [s]; only a connection that was dialed with a limit waits."""
        ...

    def sendall(self, data: Any, flags: int = 0, /) -> None:
        """Send all, and wait until there is room for it."""
        ...

    def __enter__(self) -> Any:
        """It is closed at the end of the block."""
        ...

    def __exit__(self, *_: object) -> None:
        """Close it."""
        ...


class Epoll(Protocol):
    """Waits for many sockets, as `select.epoll` does."""

    closed: bool

    def fileno(self) -> int:
        """Return its descriptor."""
        ...

    def register(self, fd: Any, eventmask: int = ..., /) -> None:
        """Wait for events of a socket."""
        ...

    def modify(self, fd: Any, eventmask: int, /) -> None:
        """Wait for other events of it; what is ready is reported again."""
        ...

    def unregister(self, fd: Any, /) -> None:
        """Wait for it no longer."""
        ...

    def poll(self, timeout: float | None = None, /) -> list[tuple[int, int]]:
        """Return what is ready, as descriptors and events, after `timeout` [s] at the latest."""
        ...

    def close(self) -> None:
        """Wait for nothing any more."""
        ...


class Event(Protocol):
    """As `threading.Event`."""

    def set(self) -> None:
        """Let all go on who wait, now and later."""
        ...

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is set, `timeout` [s] at most; returns whether it is."""
        ...


class Files(Protocol):
    """The parts of a machine that a process can look at: clocks, processes, files, listeners."""

    def now(self) -> float:
        """Return the time [s] on the machine's monotonic clock."""
        ...

    def unix(self) -> float:
        """Return the time [s] since 1970."""
        ...

    def pid(self) -> int:
        """Return the number of this process."""
        ...

    def user(self) -> int:
        """Return the number of this process's user."""
        ...

    def chance(self, size: int, /) -> bytes:
        """Return so many random bytes."""
        ...

    def lives(self, pid: int) -> bool:
        """Whether a process has not ended."""
        ...

    def text(self, path: Path) -> str:
        """Read what the kernel tells in a file of /proc."""
        ...

    def private_folder(self, path: Path) -> None:
        """See that a folder is there which only this user can enter: `files.private_folder`, strict."""
        ...

    def names(self, folder: Path) -> list[str]:
        """Return the names in a folder, in no order."""
        ...

    def status(self, path: Path) -> os.stat_result:
        """Return what is known of a name, which may be a link: lstat(2)."""
        ...

    def opened(self, path: Path, *, writes: bool = False, makes: bool = False, empties: bool = False) -> int:
        """Open an ordinary file, never through a link: `files.opened`.

        Args:
            path: of the file.
            writes: whether it can be written, too.
            makes: whether it is made if it is not there.
            empties: whether what was in it is removed.
        """
        ...

    def null(self) -> int:
        """Open the null device: a descriptor in reserve."""
        ...

    def close(self, descriptor: int) -> None:
        """Close a file."""
        ...

    def read(self, path: Path, most: int) -> bytes:
        """Read an ordinary file whole: `files.read`."""
        ...

    def pread(self, descriptor: int, size: int, at: int) -> bytes:
        """Read so many bytes at a place of a file; fewer, if it ends before."""
        ...

    def pwrite(self, descriptor: int, data: bytes, at: int) -> int:
        """Write at a place of a file; returns how much was written [bytes]."""
        ...

    def append(self, descriptor: int, data: bytes) -> int:
        """Write at the end of a file; returns how much was written [bytes]."""
        ...

    def rename(self, path: Path, to: Path) -> None:
        """Give a file or socket another name; what had that name is removed."""
        ...

    def unlink(self, path: Path) -> None:
        """Remove a name."""
        ...

    def listen(self, path: Path, backlog: int) -> Socket:
        """Return a socket that listens under a name, and does not wait.

        Args:
            path: of the socket; it is not there yet.
            backlog: connections that may wait.
        """
        ...

    def dial(self, path: Path, timeout: float = 0.0) -> Socket:
        """Return a connection to who listens under a name.

        Args:
            path: of the socket.
            timeout: [s] of the connection, and to wait for a place in line; 0: it does not wait.

        Raises:
            ConnectionRefusedError: nobody listens there any more.
            BlockingIOError: too many connections wait.
            OSError: it cannot be connected to now.
        """
        ...

    def far_end(self, line: Any) -> tuple[int, int]:
        """Return process and user at the far end of a connection (SO_PEERCRED, unix(7))."""
        ...


class System(Files, Protocol):
    """The interface of the operating system for a process."""

    @property
    def opening(self) -> AbstractContextManager[Any]:
        """Held for a moment, while a descriptor is opened and until its owner knows it: nobody forks then."""
        ...

    def owns(self, owner: forks.Owner) -> None:
        """Have a child that is forked keep nothing of an owner's, as long as the owner exists."""
        ...

    def at_exit(self, action: Callable[[], object], /) -> None:
        """Have something done when this process ends in order."""
        ...

    def not_at_exit(self, action: Callable[[], object], /) -> None:
        """Have it done no longer."""
        ...

    def lock(self) -> Any:
        """Make a lock, as `threading.Lock`."""
        ...

    def rlock(self) -> AbstractContextManager[Any]:
        """Make a lock that its holder can take again, as `threading.RLock`."""
        ...

    def event(self) -> Event:
        """Make an event that is not set."""
        ...

    def spawn(self, work: Callable[[], None], name: str) -> None:
        """Run something in a thread of its own.

        Raises:
            RuntimeError: there can be no more threads.
        """
        ...

    def here(self) -> int:
        """Return which thread this is; never 0."""
        ...

    def name_thread(self, name: str) -> None:
        """Name this thread, for people who look at threads."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Wait [s]."""
        ...

    def socketpair(self) -> tuple[Socket, Socket]:
        """Return two sockets that are connected with each other."""
        ...

    def epoll(self) -> Epoll:
        """Return what waits for sockets."""
        ...


class OS(OSFiles):
    """The production form of `System`."""

    opening = forks.opening
    owns = staticmethod(forks.owns)
    not_at_exit = staticmethod(atexit.unregister)
    lock = staticmethod(threading.Lock)
    rlock = staticmethod(threading.RLock)
    event = staticmethod(threading.Event)
    here = staticmethod(threading.get_ident)
    sleep = staticmethod(time.sleep)
    socketpair = staticmethod(socket.socketpair)
    epoll = staticmethod(select.epoll)

    def at_exit(self, action: Callable[[], object], /) -> None:
        atexit.register(action)

    def spawn(self, work: Callable[[], None], name: str) -> None:
        """See `System.spawn`. The thread is a daemon: whatever it does, its process can end."""
        threading.Thread(target=work, name=name, daemon=True).start()

    def name_thread(self, name: str) -> None:
        threading.current_thread().name = name


THIS_SYSTEM: System = OS()


def system_of(loop: object) -> System:
    """Return the system of an event loop: one in virtual time names its own, others live in the real one."""
    system: System | None = getattr(loop, "system", None)
    return THIS_SYSTEM if system is None else system
