"""The locks of robotree, each of which a test can take away: then it excludes nobody."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from typing import Any

from robotree.vr.agents.callers import Callers
from robotree.vr.agents.outside import OutsideCalls
from robotree.vr.base.presence import Presence
from robotree.vr.journal.journal import HostJournal
from robotree.vr.network.link import PeerLink
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.readers import Readers
from robotree.vr.network.refusals import Refusals
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.running.log import Log
from robotree.vr.running.process import Process, Worker
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.runner import SerialWorker
from robotree.vr.world.virtual_runner import VirtualLock

LOCKS: dict[str, tuple[type, str]] = {
    "the state of a robot": (RobotRuntime, "_lock"),
    "the timers of a process": (Process, "_lock"),
    "interruptions of a worker": (Worker, "guard"),
    "the work of a serial worker": (SerialWorker, "_lock"),
    "the callers of a robot": (Callers, "_lock"),
    "calls that wait for a host": (OutsideCalls, "_lock"),
    "what a journal was told": (HostJournal, "_lock"),
    "the file of a journal": (HostJournal, "_writing"),
    "the syncs of a journal": (HostJournal, "_syncing"),
    "the log of a robot": (Log, "_lock"),
    "the queues of a connection": (PeerLink, "_lock"),
    "the peers of a mesh": (Mesh, "_lock"),
    "the files of a process": (Rendezvous, "_lock"),
    "the number of readers": (Readers, "_counting"),
    "the one who reads": (Readers, "_reading"),
    "refusals": (Refusals, "_lock"),
    "the table of presence": (Presence, "_lock"),
}
"""What each guards: its class and its attribute there."""


class _Open:
    """A lock that excludes nobody; threads can lose the processor at it all the same."""

    def __init__(self, lock: VirtualLock) -> None:
        self._runner = lock.runner

    def acquire(self, blocking: bool = True) -> bool:  # noqa: FBT001, FBT002 # as `threading.Lock`
        del blocking
        self._runner.point()
        return True

    def release(self) -> None:
        self._runner.point()

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


@contextlib.contextmanager
def without(lock: str) -> Generator[None]:
    """Have a lock exclude nobody inside the block."""
    owner, name = LOCKS[lock]

    def get(one: Any) -> Any:
        return one.__dict__[name]

    def put(one: Any, value: Any) -> None:
        one.__dict__[name] = _Open(value)

    setattr(owner, name, property(get, put))
    try:
        yield
    finally:
        delattr(owner, name)
