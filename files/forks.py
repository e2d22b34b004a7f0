"""Things that a forked process must not keep, and places where it must not go on.

The kernel closes the connections of a process that dies: so its death is seen at once. A child that a page
makes by `os.fork` or `multiprocessing` inherits all connections: none would be closed as long as it lives.
So each descriptor of ours is the null device in the child, before the first line of its own code. The numbers
stay taken, so that what is closed later is nobody else's. What is started by exec (`subprocess`, `os.system`)
gets none: all are opened with O_CLOEXEC.

A child runs its author's code only. Of our code there is one thread left in it, and locks that other threads
held stay locked. So where it comes back into our code it ends: `expect_parent`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterable
from typing import Final, NoReturn, Protocol
from weakref import WeakSet

CODE: Final = 70
"""Exit code of a child that came back: EX_SOFTWARE of sysexits.h."""

ASKS: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
"""Signals that ask a process to end. A child has no thread that would do it politely."""

is_child = False
"""Whether this process was forked by one that uses this module."""

opening = threading.RLock()
"""Held, for a moment, while a descriptor is opened and until its owner knows it: nobody forks in between."""


class Owner(Protocol):
    """Something that has descriptors open."""

    def in_child(self) -> Iterable[int]:
        """Called in a child: return the descriptors that it must not keep. Must not block or raise."""
        ...


_owners: WeakSet[Owner] = WeakSet()


def owns(owner: Owner) -> None:
    """Have a child keep nothing of an owner's, as long as the owner exists."""
    with opening:
        _owners.add(owner)


def expect_parent() -> None:
    """End this process if it is a child; to be called where an author's code comes back into ours."""
    if is_child:
        _end()


def be_process() -> None:
    """Be a process of one's own from now on, in a child that a process without robots has forked for that."""
    global is_child  # noqa: PLW0603 # it is so once, and for good
    is_child = False


def _end() -> NoReturn:
    told = (
        f"robotree: process {os.getpid()}, forked by a page or a proxy, came back into robotree and ends; "
        "a forked process commands no robot: let it run functions of its own and end it with os._exit()\n"
    )
    with contextlib.suppress(OSError):
        os.write(2, told.encode())
    os._exit(CODE)


def _become_child() -> None:
    """In the child: keep nothing of ours. In its only thread, before any code of the author."""
    global is_child  # noqa: PLW0603 # it is so once, and for good
    is_child = True
    signal.set_wakeup_fd(-1)  # an event loop has one: a signal to the child would reach the parent's
    for number in ASKS:
        if callable(signal.getsignal(number)):
            signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ASKS)
    inherited = [descriptor for owner in list(_owners) for descriptor in owner.in_child()]
    _owners.clear()
    _replace([descriptor for descriptor in inherited if descriptor >= 0])
    opening.release()


def _replace(descriptors: Iterable[int]) -> None:
    """Put the null device in the place of what is open."""
    try:
        null = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    except OSError:  # none can be opened: to close them is the next best
        for descriptor in descriptors:
            with contextlib.suppress(OSError):
                os.close(descriptor)
        return
    for descriptor in descriptors:
        with contextlib.suppress(OSError):
            os.dup2(null, descriptor, inheritable=False)
    os.close(null)


os.register_at_fork(before=opening.acquire, after_in_parent=opening.release, after_in_child=_become_child)
