"""The two ends of stdio, bounded and without holding the loop, and the program at the other end.

A request has a size that is dealt with; a line that has more is not kept while it comes, whatever its length.
While a server runs here, descriptor 0 is the null device and 1 is the standard error: no code of a robot and
no library can read what the assistant says, or write between the answers.

A client that was stopped (Ctrl-Z, SIGSTOP, a debugger) closes nothing, and the kernel goes on to acknowledge
for it. The newest version of the protocol has no request by which a server could ask it for a sign of life;
so the kernel is asked how its process is. That is no answer of the client: one that runs and hangs is seen by
the protocol's ping, where its version has one.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import socket
import stat
import struct
import sys
from collections.abc import AsyncIterator, Generator, Iterator
from pathlib import Path
from typing import Final

CHUNK: Final = 1 << 16
"""[B] that are read at a time."""
ROOM: Final = 1 << 20
"""[B] that a pipe holds which nobody reads at the moment: a page of a long list."""
TOO_LONG: Final = (
    '{{"jsonrpc":"2.0","id":null,"error":{{"code":-32600,"message":'
    '"a line has more than {most} bytes, and was not read; send less in one request"}}}}\n'
)


class BoundedLines:
    """The lines that come from a descriptor, as text."""

    def __init__(self, descriptor: int, most: int, answers: PatientTexts) -> None:
        """Take where to read.

        Args:
            descriptor: of a pipe, a socket, a terminal or a file; it stays as it is.
            most: [B] of one line.
            answers: where it is said that a line was too long.
        """
        self._descriptor, self._most, self._answers = descriptor, most, answers
        self.refused = 0
        """Lines that were too long."""

    async def __aiter__(self) -> AsyncIterator[str]:
        """Yield each line with its end, until the other side closes."""
        kept, skips = bytearray(), False
        while chunk := await self._read():
            kept += chunk
            while (end := kept.find(b"\n")) >= 0:
                line = bytes(kept[: end + 1])
                del kept[: end + 1]
                if skips or len(line) > self._most:
                    await self._refuse()
                else:
                    yield line.decode(errors="replace")
                skips = False
            if len(kept) > self._most:
                kept.clear()
                skips = True

    async def _refuse(self) -> None:
        self.refused += 1
        await self._answers.write(TOO_LONG.format(most=self._most))

    async def _read(self) -> bytes:
        loop, ready = asyncio.get_running_loop(), asyncio.Event()
        try:
            loop.add_reader(self._descriptor, ready.set)
        except PermissionError:  # a file is always ready
            return os.read(self._descriptor, CHUNK)
        try:
            await ready.wait()
        finally:
            loop.remove_reader(self._descriptor)
        with contextlib.suppress(BlockingIOError, ConnectionError):
            return os.read(self._descriptor, CHUNK)
        return b""


class PatientTexts:
    """Texts to a descriptor: a side that does not read holds up its own answers, and nothing else."""

    def __init__(self, descriptor: int) -> None:
        """Take where to write; a pipe or a socket does not block from now on."""
        self._descriptor, self._writing = descriptor, asyncio.Lock()
        kind = os.fstat(descriptor).st_mode
        self._waits = stat.S_ISFIFO(kind) or stat.S_ISSOCK(kind)
        if self._waits:
            os.set_blocking(descriptor, False)
        if stat.S_ISFIFO(kind):
            with contextlib.suppress(OSError):  # more than this user may have: then it stays as it is
                fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, ROOM)

    async def write(self, text: str) -> None:
        """Write a text, whole.

        Raises:
            OSError: the other side has closed.
        """
        async with self._writing:
            left = memoryview(text.encode())
            while left:
                try:
                    left = left[os.write(self._descriptor, left[:ROOM]) :]
                except BlockingIOError:
                    await self._writable()

    async def flush(self) -> None:
        """Nothing is held back."""

    async def _writable(self) -> None:
        loop, ready = asyncio.get_running_loop(), asyncio.Event()
        loop.add_writer(self._descriptor, ready.set)
        try:
            await ready.wait()
        finally:
            loop.remove_writer(self._descriptor)


@contextlib.contextmanager
def own_stdio() -> Generator[tuple[int, int]]:
    """Keep the two descriptors of stdio for the server alone, for the time of a block; see the module."""
    sys.stdout.flush()
    kept = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.dup2(nothing, 0)
        os.dup2(2, 1)
        yield kept
    finally:
        os.set_blocking(kept[1], True)
        os.dup2(kept[0], 0)
        os.dup2(kept[1], 1)
        for each in (nothing, *kept):
            os.close(each)


# -- the program at the other end ------------------------------------------------------------------

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
