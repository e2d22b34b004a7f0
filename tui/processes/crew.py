"""A crew of robotree processes that ends when the process that started it ends.

Each member is a real process of the same command line that a person would type. It says `ready ADDRESS`
on its standard output when it is up, and it holds the read end of a pipe (`--tether`): when the starter
ends, whatever ended it, the pipe closes and the member ends too. So no member outlives its crew, not even
after `kill -9`.

A crew may start members again that crash: with the same words, a controller at the address that it had. After
a first crash it does so at once. Before one that goes on crashing it pauses, longer each time, but never so
long that the children of a host do not wait for it any more. Who was asked to end (SIGTERM) has not crashed.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from robotree.tui.errors import MemberFailed
from robotree.tui.processes.state_files import state_home
from robotree.vr.network.policy_file import POLICY_HOME

READY = "ready"
"""First word of the line by which a member says that it is up; the rest is its address."""

START_LIMIT = 30.0
"""[s] allowed for a member to come up: importing the simulator on a loaded machine takes several seconds."""

STOP_LIMIT = 2.5
"""[s] allowed for a polite end, before the process is killed."""

PAUSE, LONGEST_PAUSE = 0.25, 4.0
"""[s] before a member is started again that has crashed twice, and at most. Each further crash doubles it."""
SOUND = 60.0
"""[s] after which a member that runs counts as sound: its next crash is a first one."""

_log = logging.getLogger(__name__)


def pause_after(crashes: int) -> float:
    """Return how long a crew waits before it starts a member again [s].

    Args:
        crashes: of the member, one soon after the other.
    """
    return 0.0 if crashes <= 1 else min(PAUSE * 2.0 ** min(crashes - 2, 10), LONGEST_PAUSE)


class Member:
    """One process of the crew."""

    def __init__(self, words: Sequence[str], process: asyncio.subprocess.Process, log: IO[bytes]) -> None:
        """Take over a process that was just started; `log` is where its standard error goes."""
        self.words, self.process, self._log = tuple(words), process, log
        self.address = ""
        self.began = time.monotonic()

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
        self.kill()
        await self.process.wait()

    def kill(self) -> None:
        """End it at once, if it has not ended."""
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()

    @property
    def words_again(self) -> tuple[str, ...]:
        """The words that start the same once more: a controller or a hub listens where it has listened."""
        words = [*self.words]
        if "--listen" in words and self.address:
            words[words.index("--listen") + 1] = self.address.partition("#")[0]  # a hub's fingerprint
        return tuple(words)

    def _last(self) -> str:
        lines = self.log.strip().splitlines()
        return "\n".join(line.removeprefix("robotree: ") for line in lines[-3:])


class Crew:
    """Starts members, in order or at once, and ends them all, the last one first."""

    def __init__(
        self,
        realm: str,
        logs: Path | None = None,
        *,
        key: str = "",
        state: Path | None = None,
        runtime: Path | None = None,
        restarts: bool = False,
    ) -> None:
        """Prepare a crew without members.

        Args:
            realm: in which the members live.
            logs: folder of the files to which they write what they have to say. Without one those files have
                no name, so that nothing of them stays behind, whatever ends us.
            key: file with the key of all links between members, or `none`; empty: `$ROBOTREE_KEY` decides.
            state: folder of what the members keep; None: that of this user.
            runtime: folder in which the members meet; None: that of this user.
            restarts: whether a member that crashes is started again.
        """
        self.realm, self.logs = realm, logs
        self._environment = {"ROBOTREE_REALM": realm, **({"ROBOTREE_KEY": key} if key else {})}
        self._environment |= {"XDG_STATE_HOME": str(state)} if state else {}
        self._environment |= {"XDG_RUNTIME_DIR": str(runtime)} if runtime else {}
        if state and not runtime:  # they meet with all that this user starts, and obey the same policy
            self._environment[POLICY_HOME] = str(state_home())
        self.restarts = restarts
        self.members: list[Member] = []
        self._started = set[str]()
        """The words that name the members: their roles and names."""
        self._watches: set[asyncio.Task[None]] = set()
        self._numbers = itertools.count()

    async def start(self, *words: str) -> Member:
        """Start `robotree WORDS…` and wait until it is ready.

        Raises:
            MemberFailed: it did not come up.
        """
        member = await self._spawn(words)
        await member.ready()
        self._started.update(words[:3])
        watch = asyncio.create_task(self._watch(member), name=f"watches {' '.join(words[:3])}")
        self._watches.add(watch)
        watch.add_done_callback(self._watches.discard)
        return member

    def starts_again(self, name: str) -> bool:
        """Whether the member of this name is started again when it crashes; of others: False."""
        return self.restarts and name in self._started

    async def _spawn(self, words: Sequence[str]) -> Member:
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
        return member

    async def _watch(self, member: Member) -> None:
        """Start a member again whenever it crashes."""
        crashes = 0
        while (code := await member.process.wait()) and self.restarts:
            crashes = 1 if time.monotonic() - member.began > SOUND else crashes + 1
            line = " ".join(member.words[:3])
            _log.warning("%s has ended with code %d, and is started again", line, code)
            await asyncio.sleep(pause_after(crashes))
            self.members.remove(member)
            await member.stop()
            member = await self._spawn(member.words_again)
            try:
                await member.ready()
            except MemberFailed as failure:
                _log.warning("%s did not come up again: %s", line, failure)
                member.kill()

    def _open_log(self, words: Sequence[str]) -> IO[bytes]:
        if self.logs is None:
            return tempfile.TemporaryFile()
        name = "-".join(word for word in words[:3] if word.isidentifier())
        return (self.logs / f"{name}-{next(self._numbers)}.log").open("w+b")

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
        watches = [*self._watches]
        for watch in watches:
            watch.cancel()
        await asyncio.gather(*watches, return_exceptions=True)
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
