"""The processes of the campaign: a small realm of real processes, and command lines beside them.

What a controller really does is seen over a separate link: the truth that all reports are compared with.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import math
import os
import re
import signal
import time
from collections import deque
from collections.abc import AsyncIterator, Generator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from robotree.client.joining import joined
from robotree.protocol import Endpoint, Frame
from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import CommandLong, LocalPositionNed, MavCmd, Mode, ModeKind, Tool
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import Crew, Member
from robotree.vr.base.errors import VrError
from robotree.vr.supervision.realm_client import RealmClient
from tests.command_line import ROBOTREE
from tests.soak.table import Trial
from tests.station import BEAT

OFTEN = 5000.0
"""[us] between two places: 200 a second."""
STANDS = 0.01
"""[m/s] A robot that is slower than this stands."""
KEPT = 20_000
"""Places that are remembered: more than a minute."""
REDIAL = 0.1
"""[s]"""
SPAN = 0.05
"""[s] over which a speed is taken."""


@dataclass(frozen=True, slots=True)
class Seen:
    """Where a robot was."""

    heard: float
    """[s] on our clock."""
    at: float
    """[s] on the controller's, since it started."""
    place: tuple[float, float, float]
    """(3,) [m]"""


class Observer:
    """Watches one controller and commands nothing. It connects again whenever its link ends.

    Args:
        address: of the controller.
        system: MAVLink system id, other than those of proxies and ground stations.
    """

    def __init__(self, address: str, system: int = 77) -> None:
        self.address, self._system = address, system
        self.seen: deque[Seen] = deque(maxlen=KEPT)
        self.modes: deque[tuple[float, Mode]] = deque(maxlen=KEPT)
        self._link: Link | None = None
        self._work: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._work = asyncio.create_task(self._keep())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._work is not None:
            self._work.cancel()
            await asyncio.gather(self._work, return_exceptions=True)
        if self._link is not None:
            self._link.close()

    async def _keep(self) -> None:
        while True:
            over = asyncio.Event()
            with contextlib.suppress(LinkError, OSError):
                await self._dial(over)
                await over.wait()
            await asyncio.sleep(REDIAL)

    async def _dial(self, over: asyncio.Event) -> None:
        ends: list[Endpoint] = []

        def accept(link: Link) -> Endpoint:
            ends.append(
                Endpoint(
                    link,
                    system=self._system,
                    component=1,
                    on_frame=self._hear,
                    on_closed=lambda _reason: over.set(),
                )
            )
            return ends[0]

        self._link = await connect(self.address, accept)
        ends[0].send(BEAT)
        for kind in (Tool, LocalPositionNed):
            wish = (float(kind.codec.definition.id), OFTEN, 0.0, 0.0, 0.0, 0.0, 0.0)
            ends[0].send(CommandLong(1, 1, MavCmd.SET_MESSAGE_INTERVAL, 0, *wish))

    def _hear(self, frame: Frame) -> None:
        now, message = time.monotonic(), frame.message
        if isinstance(message, Tool | LocalPositionNed):
            place = (message.x, message.y, message.z)
            self.seen.append(Seen(now, message.time_boot_ms / 1000, place))
        elif isinstance(message, Mode):
            self.modes.append((now, message))

    # -- what is seen ------------------------------------------------------------------------------

    @property
    def place(self) -> tuple[float, float, float]:
        """(3,) [m] where it was last."""
        return self.seen[-1].place if self.seen else (math.nan,) * 3

    @property
    def mode(self) -> int:
        """What it does as a whole, a `ModeKind`; -1: nothing was heard yet."""
        return self.modes[-1][1].mode if self.modes else -1

    @property
    def stopped(self) -> bool:
        """Whether it is in safe stop."""
        return self.mode == ModeKind.SAFE_STOP

    @property
    def fresh(self) -> bool:
        """Whether it was heard within the last 0.3 s."""
        return bool(self.seen) and time.monotonic() - self.seen[-1].heard < 0.3

    def speed(self) -> float:
        """[m/s] over the last moment."""
        if not self.seen:
            return 0.0
        last = self.seen[-1]
        for one in reversed(self.seen):
            if one.at > last.at:
                return 0.0  # it has started anew
            if last.at - one.at >= SPAN:
                return math.dist(one.place, last.place) / (last.at - one.at)
        return 0.0

    def mark(self) -> tuple[float, float]:
        """This moment: on our clock, and on the controller's as last heard."""
        return time.monotonic(), self.seen[-1].at if self.seen else 0.0

    def after(self, mark: tuple[float, float]) -> list[Seen]:
        """Return what was seen from a moment on, in one life of the controller."""
        return [one for one in self.seen if one.heard >= mark[0] and one.at >= mark[1]]

    def stood_after(self, mark: tuple[float, float]) -> float:
        """[s] on the controller's clock from a moment until it moved no more; 0: it never did."""
        moved = self._moved_last(mark)
        return 0.0 if moved is None else moved.at - mark[1]

    def stood_at(self, mark: tuple[float, float]) -> float:
        """[s] on our clock: when it was last heard to move since a moment; else that moment.

        On a busy machine it is heard late, so it stood somewhat earlier.
        """
        moved = self._moved_last(mark)
        return mark[0] if moved is None else moved.heard

    def _moved_last(self, mark: tuple[float, float]) -> Seen | None:
        """Where it was last seen to move since a moment; None: it never did."""
        moved = None
        for then, now in itertools.pairwise(self.after(mark)):
            if now.at > then.at and math.dist(then.place, now.place) / (now.at - then.at) >= STANDS:
                moved = now
        return moved

    def way_since(self, mark: tuple[float, float]) -> float:
        """[m] that it has gone since a moment, along its path; noise below a millimetre is left out."""
        way, last = 0.0, None
        for one in self.seen:
            if one.heard < mark[0]:
                continue
            if last is None or math.dist(last, one.place) >= 0.001:
                way += 0.0 if last is None else math.dist(last, one.place)
                last = one.place
        return way

    async def moves(self, within: float = 10.0, faster: float = 0.03) -> bool:
        """Wait until it moves."""
        return await holds(lambda: self.speed() > faster, within)

    async def stands(self, within: float = 10.0) -> bool:
        """Wait until it stands, and has for a moment."""
        return await holds(lambda: self.fresh and self.speed() < STANDS, within)


async def holds(what: object, within: float) -> bool:
    """Wait until a condition holds; whether it came to that."""
    assert callable(what)
    until = time.monotonic() + within
    while not what():
        if time.monotonic() > until:
            return False
        await asyncio.sleep(0.01)
    return True


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

    async def expect_whole(self, trial: Trial) -> None:
        """Have a trial fail if the realm is not whole after it."""
        if not await self.whole():
            trial.reached, trial.note = False, f"the realm is not whole {WHOLE:g} s later"

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

    async def send(self, robot: str, y: float) -> Said:
        """Have an arm go to a place before it, and wait until the command line has ended."""
        place = ("x=0.45", f"y={y}", "z=0.35", "twist=0")
        return await self.say("call", f"{robot}.go_to", *place, "--within", "10 s")

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
        with suspended(self.pid(name)):
            await asyncio.sleep(seconds)

    @asynccontextmanager
    async def another_arm(
        self,
        name: str,
        *words: str,
        kind: str = "arm",
        listens: str = "tcp:127.0.0.1:0",
        key: Sequence[str] = (),
    ) -> AsyncIterator[Observer]:
        """Start one more arm and its proxy: the members `NAME controller` and `NAME proxy`.

        Args:
            name: of the robot.
            words: more of the controller's line.
            kind: of the proxy.
            listens: where the controller listens.
            key: words for the line of both.
        """
        members = (f"{name} proxy", f"{name} controller")
        controller = await self.start(members[1], "sim", "arm", *words, *key, "--listen", listens)
        self.comes_back_at(members[1], controller.address)
        try:
            await self.start(members[0], "proxy", kind, name, "--connect", controller.address, *key)
            async with Observer(controller.address, 80) as arm:
                await holds(lambda: arm.fresh, 5.0)
                yield arm
        finally:
            for member in members:
                if member in self.members:
                    await self.kill(member)


@contextlib.contextmanager
def suspended(pid: int) -> Generator[None]:
    """Have a process stand still inside the block."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
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
