"""The program at the other end of a connection: whether it is stopped while its connection stays open.

A client that was stopped (Ctrl-Z, SIGSTOP, a debugger) closes nothing, and the kernel goes on to acknowledge
for it. The newest version of the protocol has no request by which a server could ask it for a sign of life;
so the kernel is asked how its process is. That is no answer of the client: one that runs and hangs is seen by
the protocol's ping, where its version has one.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
STOPPED: Final = frozenset({"T", "t"})
"""States of a process that carries nothing out: proc_pid_stat(5)."""


class Peer:
    """The processes that hold the other end of a connection."""

    def __init__(self, end: str, processes: list[int]) -> None:
        """Take what /proc calls that end, `pipe:[123]`; empty: the processes are known."""
        self._end, self._processes = end, processes

    def stopped(self) -> bool:
        """Whether all of them are stopped; one that cannot be seen is not."""
        states = [state_of(process) for process in self._processes]
        if self._end and (not states or not all(states)):
            self._processes = [*holders(self._end)]
            states = [state_of(process) for process in self._processes]
        return bool(states) and all(state in STOPPED for state in states)


def of_descriptor(descriptor: int) -> Peer:
    """Return who is at the other end of a pipe or of a pair of sockets."""
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISFIFO(kind):
        return Peer(str((PROC / "self" / "fd" / str(descriptor)).readlink()), [])
    if stat.S_ISSOCK(kind):
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as end:
            size = struct.calcsize("3i")
            process, _, _ = struct.unpack("3i", end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
            return Peer("", [process])
    return Peer("", [])


def of_connection(there: int, here: int) -> Peer:
    """Return who is at the other end of a TCP connection over loopback, by the two ports."""
    with contextlib.suppress(OSError):
        for row in (PROC / "net" / "tcp").read_text().splitlines()[1:]:
            _, local, remote, _, _, _, _, _, _, inode, *_ = row.split()
            if (_port(local), _port(remote)) == (there, here) and inode != "0":
                return Peer(f"socket:[{inode}]", [])
    return Peer("", [])


def holders(end: str) -> Iterator[int]:
    """Iterate over the other processes of this user that hold a pipe or a socket, as /proc calls it."""
    for folder in PROC.iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            if any(_leads_to(each, end) for each in (folder / "fd").iterdir()):
                yield int(folder.name)


def state_of(process: int) -> str:
    """Return the letter for the state of a process; empty: it is gone."""
    with contextlib.suppress(OSError):
        _, _, rest = (PROC / str(process) / "stat").read_text().rpartition(")")
        return rest.split()[0]
    return ""


def _leads_to(link: Path, end: str) -> bool:
    with contextlib.suppress(OSError):
        return str(link.readlink()) == end
    return False


def _port(address: str) -> int:
    return int(address.rpartition(":")[2], 16)
