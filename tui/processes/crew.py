"""A crew of robotree processes that ends when the process that started it ends.

Each member is a real process of the same command line that a person would type. It says `ready ADDRESS`
on its standard output when it is up, and it holds the read end of a pipe (`--tether`): when the starter
ends, whatever ended it, the pipe closes and the member ends too. So no member outlives its crew, not even
after `kill -9`.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from robotree.tui.errors import MemberFailed

READY = "ready"
"""First word of the line by which a member says that it is up; the rest is its address."""

START_LIMIT = 30.0
"""[s] allowed for a member to come up: importing the simulator on a loaded machine takes several seconds."""

STOP_LIMIT = 2.5
"""[s] allowed for a polite end, before the process is killed."""


class Member:
    """One process of the crew."""

    def __init__(self, words: Sequence[str], process: asyncio.subprocess.Process, log: IO[bytes]) -> None:
        """Take over a process that was just started; `log` is where its standard error goes."""
        self.words, self.process, self._log = tuple(words), process, log
        self.address = ""

    @property
    def log(self) -> str:
        """Its standard error output so far."""
        size = os.fstat(self._log.fileno()).st_size
        return os.pread(self._log.fileno(), size, 0).decode(errors="replace")

    @property
    def pid(self) -> int:
        """Its process id."""
        return self.process.pid

    async def ready(self) -> str:
        """Wait until it says that it is up.

        Returns:
            The address it said.

        Raises:
            MemberFailed: it ended before, or said nothing for `START_LIMIT`.
        """
        out = self.process.stdout
        assert out is not None  # noqa: S101 # started with a pipe
        try:
            async with asyncio.timeout(START_LIMIT):
                while line := (await out.readline()).decode(errors="replace").strip():
                    word, _, rest = line.partition(" ")
                    if word == READY:
                        self.address = rest
                        return rest
        except TimeoutError:
            raise MemberFailed(self.words, f"was not ready within {START_LIMIT:g} s", self._last()) from None
        await self.process.wait()
        raise MemberFailed(self.words, f"ended with code {self.process.returncode}", self._last())

    async def stop(self) -> None:
        """Cut the tether, then end it politely, then surely."""
        try:
            await self._end()
        finally:
            self._log.close()

    async def _end(self) -> None:
        if self.process.stdin:
            self.process.stdin.close()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOP_LIMIT):
                await self.process.wait()
                return
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        await self.process.wait()

    def _last(self) -> str:
        lines = self.log.strip().splitlines()
        return "\n".join(line.removeprefix("robotree: ") for line in lines[-3:])


class Crew:
    """Starts members, in order or at once, and ends them all, the last one first."""

    def __init__(self, realm: str, logs: Path | None = None, *, key: str = "") -> None:
        """Prepare a crew without members.

        Args:
            realm: in which the members live.
            logs: folder of the files to which they write what they have to say. Without one those files have
                no name, so that nothing of them stays behind, whatever ends us.
            key: file with the key of all links between members, or `none`; empty: `$ROBOTREE_KEY` decides.
        """
        self.realm, self.logs = realm, logs
        self._environment = {"ROBOTREE_REALM": realm, **({"ROBOTREE_KEY": key} if key else {})}
        self.members: list[Member] = []

    async def start(self, *words: str) -> Member:
        """Start `robotree WORDS…` and wait until it is ready.

        Raises:
            MemberFailed: it did not come up.
        """
        log = self._open_log(words)
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *("-m", "robotree.tui", *words, "--tether"),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=log,
            env={**os.environ, **self._environment},
            start_new_session=True,  # Ctrl-C is for the starter, who then ends its crew in order
        )
        member = Member(words, process, log)
        self.members.append(member)
        await member.ready()
        return member

    def _open_log(self, words: Sequence[str]) -> IO[bytes]:
        if self.logs is None:
            return tempfile.TemporaryFile()
        name = "-".join(word for word in words[:3] if word.isidentifier())
        return (self.logs / f"{name}-{len(self.members)}.log").open("w+b")

    async def start_all(self, *commands: Sequence[str]) -> list[Member]:
        """Start several at once.

        Raises:
            MemberFailed: one did not come up (the first one that failed).
        """
        results = await asyncio.gather(*(self.start(*words) for words in commands), return_exceptions=True)
        members: list[Member] = []
        for result in results:
            if isinstance(result, BaseException):
                raise result
            members.append(result)
        return members

    async def stop(self) -> None:
        """End every member. Twice is once."""
        members, self.members = self.members, []
        await asyncio.gather(*(member.stop() for member in reversed(members)))

    async def __aenter__(self) -> Self:
        """Enter with an empty crew."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the crew, whatever happened."""
        await asyncio.shield(self.stop())
