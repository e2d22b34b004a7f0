"""The processes of the campaign: a small realm of real processes, and command lines beside them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robotree.client.joining import joined
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import Crew, Member
from robotree.vr.base.errors import VrError
from robotree.vr.supervision.realm_client import RealmClient
from tests.command_line import ROBOTREE
from tests.soak.observer import Observer, holds

ROOT = Path(__file__).parents[2]
ARM, ROVER, SQUARE = "arm-1", "rover-1", "square"
SIDE = 0.2
"""[m] of the square that the rover drives."""
REACH = 0.2
"""[m] to the left and to the right: the arm moves between these two places."""
FAR = 0.5
"""[m] from the middle of its floor; a rover that is farther away is driven back before the next trial."""
WHOLE = 10.0
"""[s] A realm whose members do not all see each other after this time has not healed."""
LONGEST_CALL = 20.0
"""[s] for a call, and for the command line to report how it ended."""


@dataclass(frozen=True, slots=True)
class Said:
    """The result of a command line."""

    words: tuple[str, ...]
    code: int | None
    """Exit code; None: it did not end by itself."""
    out: str
    complaints: str
    seconds: float
    """[s] from its start to its end."""

    @property
    def done(self) -> bool:
        """Whether it claims success."""
        return self.code == 0

    def __str__(self) -> str:
        """Name it in one line."""
        last = (self.complaints or self.out).strip().splitlines()[-1:] or [""]
        return f"`{' '.join(self.words)}` ended with {self.code} after {self.seconds:.2f} s: {last[0]}"


class Verb:
    """A running command line."""

    def __init__(self, words: Sequence[str], process: asyncio.subprocess.Process, began: float) -> None:
        self.words, self.process, self.began = tuple(words), process, began
        self._hearing = asyncio.create_task(self._hear())

    @property
    def pid(self) -> int:
        """Its process."""
        return self.process.pid

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self._hearing.done()

    async def end(self, within: float = LONGEST_CALL + 5.0) -> Said:
        """Wait until it has ended; one that does not end is killed, and the result tells so."""
        if not (await asyncio.wait([self._hearing], timeout=within))[0]:
            self.kill()
            return Said(self.words, None, "", "", (await self._hearing).seconds)
        return self._hearing.result()

    def kill(self) -> None:
        """Kill it, if it still runs."""
        if self.process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self.process.kill()

    async def _hear(self) -> Said:
        out, complaints = await self.process.communicate()
        seconds = time.monotonic() - self.began
        said, complained = out.decode(errors="replace"), complaints.decode(errors="replace")
        return Said(self.words, self.process.returncode, said, complained, seconds)


class Stage:
    """A realm: an arm, a rover, a virtual robot above the rover, two lookup services, and observers."""

    def __init__(self, realm: str, crew: Crew, ties: AsyncExitStack) -> None:
        self.realm, self._crew, self._ties = realm, crew, ties
        self.shared = ""
        """Why the folders of realm and state have no file systems of their own; empty: they have."""
        self.members: dict[str, Member] = {}
        self._lines: dict[str, tuple[str, ...]] = {}
        self.realm_client: RealmClient
        self.arm: Observer
        self.rover: Observer
        self._side = 1
        self._furniture = list[str]()

    # -- processes ---------------------------------------------------------------------------------

    async def start(self, name: str, *words: str) -> Member:
        """Start a member and remember how."""
        member = await self._crew.start(*words)
        self.members[name], self._lines[name] = member, words
        return member

    async def kill(self, name: str) -> None:
        """Kill a member."""
        member = self.members.pop(name)
        with contextlib.suppress(ProcessLookupError):  # it has ended already
            member.process.kill()
        await member.process.wait()
        self._crew.members.remove(member)
        await member.stop()  # nothing is left to stop but its pipes

    async def restart(self, name: str) -> float:
        """Restart a killed member. Returns: when it was ready [s, own clock]."""
        await self.start(name, *self._lines[name])
        return time.monotonic()

    def comes_back_at(self, name: str, address: str) -> None:
        """Let a restarted controller listen at its old address."""
        *words, _ = self._lines[name]
        self._lines[name] = (*words, address)

    def line_of(self, name: str) -> tuple[str, ...]:
        """Return the words with which a member is started."""
        return self._lines[name]

    def dead(self) -> list[str]:
        """Return the members of the stage that do not run."""
        return [name for name in self._furniture if name not in self.members]

    def pid(self, name: str) -> int:
        """The process of a member."""
        return self.members[name].pid

    async def verb(self, *words: str, limits: str = "", program: Sequence[str] = ROBOTREE) -> Verb:
        """Start a command line.

        Args:
            words: of the line.
            limits: for its process, as `ulimit` takes them: `-n 12`.
            program: that is started.
        """
        within = ("sh", "-c", f'ulimit {limits}; exec "$@"', "sh") if limits else ()
        began = time.monotonic()  # on a busy machine it takes long until we go on, and the line runs already
        process = await asyncio.create_subprocess_exec(
            *within,
            *program,
            *words,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "ROBOTREE_REALM": self.realm},
            start_new_session=True,
        )
        verb = Verb(words, process, began)
        self._ties.callback(verb.kill)
        return verb

    async def say(self, *words: str, within: float = 30.0) -> Said:
        """Run a command line to its end."""
        return await (await self.verb(*words)).end(within)

    # -- the state in which trials begin -----------------------------------------------------------

    @property
    def folder(self) -> Path:
        """Where the realm's processes meet."""
        return Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / self.realm

    async def furnish(self) -> None:
        """Resume, and bind the rover to the virtual robot again if the bond is lost.

        Raises:
            VrError: it cannot be done.
        """
        until = time.monotonic() + WHOLE
        while True:
            try:
                await self._furnish()
            except VrError:
                if time.monotonic() > until:
                    raise
                await asyncio.sleep(0.1)
            else:
                return

    async def _furnish(self) -> None:
        await self.realm_client.resume(None)
        known = {one.name: one for one in await self.realm_client.tree()}
        if SQUARE not in known:
            await self.realm_client.create(str(ROOT / "examples" / "move_square.py"), SQUARE)
            known = {one.name: one for one in await self.realm_client.tree()}
        if not any(slot.child for slot in known[SQUARE].slots):
            await self.realm_client.enslave(SQUARE, "rover", ROVER)
        away = self.rover.place
        if max(map(abs, away[:2])) > FAR:
            home = {"x": -away[0], "y": away[1]}  # on the wire y is to the right, in a call to the left
            await self.realm_client.call(SQUARE, "move", home, deadline=10)
        for observer in (self.arm, self.rover):
            await observer.stands()

    async def whole(self, within: float = WHOLE) -> bool:
        """Wait until all members are seen and answer, also to a new process."""
        wanted = {ARM, ROVER}

        async def complete(realm_client: RealmClient) -> bool:
            with contextlib.suppress(VrError):
                found = {one.name for one in await realm_client.tree() if one.online}
                return wanted <= found and len(realm_client.services) == 2
            return False

        until = time.monotonic() + within
        while time.monotonic() < until:
            if await complete(self.realm_client):
                with contextlib.suppress(VrError):
                    async with joined(self.realm) as newcomer:
                        if await complete(newcomer):
                            return True
            await asyncio.sleep(0.02)
        return False

    # -- commands in flight ------------------------------------------------------------------------

    async def move_arm(self, speed: float = 0.15) -> tuple[Verb, tuple[float, float, float]]:
        """Move the arm to the other side. Returns: the command line, and the goal (3,) [m]."""
        self._side = -1 if self.arm.place[1] > 0 else 1
        goal = (0.45, self._side * REACH, 0.35)
        given = [f"{name}={value}" for name, value in zip("xyz", goal, strict=True)]
        line = (
            "call",
            f"{ARM}.go_to",
            *given,
            "twist=0",
            f"speed={speed}",
            "--within",
            f"{LONGEST_CALL:g} s",
        )
        return await self.verb(*line), goal

    async def move_square(self) -> tuple[Verb, tuple[float, float, float]]:
        """Let the rover drive a square. Returns: the command line, and the start (3,) [m]."""
        here = self.rover.place
        line = ("call", f"{SQUARE}.move_square", f"length={SIDE}", "--within", f"{LONGEST_CALL:g} s")
        return await self.verb(*line), here

    async def both_move(self) -> tuple[Verb, Verb]:
        """Move both robots, the rover through the virtual robot.

        Raises:
            MemberFailed: one of them does not.
        """
        calls = (await self.move_arm())[0], (await self.move_square())[0]
        began = await asyncio.gather(self.arm.moves(), self.rover.moves())
        if not all(began):
            said = await asyncio.gather(*(call.end(1.0) for call in calls))
            raise MemberFailed(("call",), "moves nothing", "; ".join(map(str, said)))
        return calls

    async def frozen(self, name: str, seconds: float) -> None:
        """Stop a member with SIGSTOP for some time."""
        pid = self.pid(name)
        os.kill(pid, signal.SIGSTOP)
        try:
            await asyncio.sleep(seconds)
        finally:
            os.kill(pid, signal.SIGCONT)


def missed(said: Said) -> set[str]:
    """Return the names of the robots that a stop reports as not reached."""
    found = re.search(r"NOT by (.*)", said.complaints)
    return set(re.findall(r"\b(?:arm|rover|square|layer)(?:-\d+)?\b", found[1])) if found else set()


def names(said: Said) -> set[str]:
    """Return the names of the robots that a stop with `--json` reports as stopped."""
    with contextlib.suppress(ValueError):
        data: Any = json.loads(said.out)
        return set(data.get("stopped", ()))
    return set()


@asynccontextmanager
async def staged(realm: str, logs: Path) -> AsyncIterator[Stage]:
    """Start all processes, and end them afterwards.

    Raises:
        MemberFailed: a process did not come up.
    """
    async with AsyncExitStack() as ties, Crew(realm, logs) as crew:
        stage = Stage(realm, crew, ties)
        arm = await stage.start("arm controller", "sim", "arm", "--listen", "tcp:127.0.0.1:0")
        rover = await stage.start("rover controller", "sim", "rover", "--listen", "tcp:127.0.0.1:0")
        stage.comes_back_at("arm controller", arm.address)
        stage.comes_back_at("rover controller", rover.address)
        await stage.start("lookup-1", "lookup", "lookup-1")
        await stage.start("lookup-2", "lookup", "lookup-2")
        await stage.start("host", "host", "host-1")
        await stage.start("arm proxy", "proxy", "arm", ARM, "--connect", arm.address)
        await stage.start("rover proxy", "proxy", "rover", ROVER, "--connect", rover.address)
        stage.realm_client = await ties.enter_async_context(joined(realm))
        stage.arm = await ties.enter_async_context(Observer(arm.address))
        stage.rover = await ties.enter_async_context(Observer(rover.address))
        if not await holds(lambda: stage.arm.fresh and stage.rover.fresh, 10.0):
            raise MemberFailed(("sim",), "does not tell where it is", "")
        await stage.furnish()
        stage._furniture = list(stage.members)
        yield stage
