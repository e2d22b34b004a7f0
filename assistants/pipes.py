"""The two ends of stdio: lines that are read bounded, and texts that are written without holding the loop.

A request has a size that is dealt with; a line that has more is not kept while it comes, whatever its length.
While a server runs here, descriptor 0 is the null device and 1 is the standard error: no code of a robot and
no library can read what the assistant says, or write between the answers.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import stat
import sys
from collections.abc import AsyncIterator, Generator
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
