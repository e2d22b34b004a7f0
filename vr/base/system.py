"""The interface of the machine for the network of a process, and nothing more.

It is as thin as can be: what is called often is the operating system's own function. In place of a `System`,
code that takes these things from one can be given the machine of `tests/world/machine.py`: in virtual time,
with faults from a seed. `tests/vr/world/test_system_contract.py` holds one against the other.
`running/runner.py` is the same for the code of robots.
"""

from __future__ import annotations

import atexit
import select
import socket
import threading
import time
from collections.abc import Callable

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


Socket = socket.socket
"""A Unix stream socket, or what stands for one on a simulated machine."""


class System(OSFiles):
    """The interface of the operating system for a process."""

    opening = forks.opening
    """Held for a moment, while a descriptor is opened and until its owner knows it: nobody forks then."""
    owns = staticmethod(forks.owns)
    """Has a child that is forked keep nothing of an owner's, as long as the owner exists."""
    not_at_exit = staticmethod(atexit.unregister)
    lock = staticmethod(threading.Lock)
    rlock = staticmethod(threading.RLock)
    event = staticmethod(threading.Event)
    here = staticmethod(threading.get_ident)
    """Returns which thread this is; never 0."""
    sleep = staticmethod(time.sleep)
    socketpair = staticmethod(socket.socketpair)
    epoll = staticmethod(select.epoll)

    def at_exit(self, action: Callable[[], object], /) -> None:
        """Have something done when this process ends in order."""
        atexit.register(action)

    def spawn(self, work: Callable[[], None], name: str) -> None:
        """Run something in a thread of its own, a daemon: whatever it does, its process can end.

        Raises:
            RuntimeError: there can be no more threads.
        """
        threading.Thread(target=work, name=name, daemon=True).start()

    def name_thread(self, name: str) -> None:
        """Name this thread, for people who look at threads."""
        threading.current_thread().name = name


THIS_SYSTEM = System()


def system_of(loop: object) -> System:
    """Return the system of an event loop: one in virtual time names its own, others live in the real one."""
    system: System | None = getattr(loop, "system", None)
    return THIS_SYSTEM if system is None else system
