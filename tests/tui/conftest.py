"""A whole realm in memory: real agents, lookup and host, and an arm of paper beside a lever of paper."""

from __future__ import annotations

import asyncio
import io
import math
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import msgspec
import pytest
from PIL import Image, ImageDraw

from robotree.tui import words
from robotree.tui.session.playing import Player
from robotree.tui.session.script import PlayedStep, Report, read
from robotree.vr import CommandFailed, Range, Robot, Unit, VrError, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.agents.view import ViewAgent
from robotree.vr.base import envelope
from robotree.vr.base.requests import CameraLens, Shot
from robotree.vr.exchange import claim
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.lookup import registrar
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.testing import until

EXAMPLES = Path(__file__).parents[2] / "examples"

AXLE_X, AXLE_Z, RADIUS, STOP = 0.42, 0.08, 0.20, 0.785
"""Where the lever of the examples stands [m], and where it stops [rad]."""

Place = Annotated[float, Unit("m"), Range(-0.8, 0.8), "a place"]
Angle = Annotated[float, Unit("rad"), Range(-math.pi, math.pi)]


@pytest.fixture(autouse=True)
def in_english_afterwards() -> Iterator[None]:
    """The language is chosen once for a process: no test leaves its own to the next one."""
    yield
    words.choose("en")


class Info(msgspec.Struct, frozen=True):
    x: float
    y: float
    z: float
    twist: float
    fx: float
    fy: float
    fz: float
    width: float


class Arm(Robot):
    """An arm of paper: it is where it was told to be, a moment later."""

    reading_units: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("x", "y", "z", "width"), "m"),
        **dict.fromkeys(("twist", "j1"), "rad"),
        "age": "s",
    }

    def __init__(self, name: str = "arm-1") -> None:
        super().__init__(name, {"place": "table"})
        self.pose = {"x": 0.35, "y": 0.0, "z": 0.4, "twist": 0.0}
        self.width = 0.08
        self.lever = -STOP
        self.pace = 0.002
        """[s] for each of the ten parts of a way."""
        self.under_way = False
        """Set to have it stay under way."""
        self.calls: list[str] = []

    @command(effect="repeat")
    def go_to(
        self, x: Place, y: Place, z: Place, twist: Angle, speed: Annotated[float, Unit("m/s")] = 0.1
    ) -> None:
        """Move the gripper to a point."""
        self.calls.append("go_to")
        del speed
        start, end = dict(self.pose), {"x": x, "y": y, "z": z, "twist": twist}
        for part in range(1, 11):
            self.sleep(self.pace)
            while self.under_way:
                self.sleep(self.pace)
            self.pose = {axis: start[axis] + part / 10 * (end[axis] - start[axis]) for axis in end}
            self.progress(part / 10, f"{10 - part} to go")
        if self.width < 0.08 and self.holds:
            self.lever = math.atan2(self.pose["x"] - AXLE_X, self.pose["z"] - AXLE_Z)

    holds = False

    @command(effect="read")
    def get_info(self) -> Info:
        """Tell where it is."""
        return Info(**self.pose, fx=1.5, fy=-2.0, fz=-20.0, width=self.width)

    @command(effect="repeat")
    def grip(self, action: Literal["open", "close", "width"], width: float = 0.08) -> None:
        """Open or close the gripper."""
        if action == "close":
            handle = (AXLE_X + RADIUS * math.sin(self.lever), AXLE_Z + RADIUS * math.cos(self.lever))
            self.holds = math.dist(handle, (self.pose["x"], self.pose["z"])) < 0.02
            self.width = 0.02 if self.holds else 0.0
        else:
            self.holds, self.width = False, width

    @command
    def hold(self) -> None:
        """Stay here."""

    @command
    def halt(self) -> None:
        """Stop here."""

    @command(effect="read")
    def shout(self, text: str, times: int = 1, loud: bool = False) -> str:  # noqa: FBT001, FBT002 # a command
        """Repeat what it hears [not markup]."""
        return (text.upper() if loud else text) * times

    @command
    def stumble(self) -> None:
        """Fail."""
        raise CommandFailed(robot=self.name, command="stumble", detail="a stone [/x] lay there")

    def readings(self) -> dict[str, float]:
        forces = {"fx": 1.5, "fy": -2.0, "fz": -20.0, "tx": -0.01}
        return {**self.pose, **forces, "width": self.width, "j1": 0.25, "age": 0.125}


class Rover(Robot):
    """A rover of paper."""

    @command
    def move(self, x: Place, y: Place) -> None:
        """Go somewhere."""


CLEAR, TITLE, C1, TURN, BELL = "\x1b[2J", "\x1b]0;owned\x07", "\x9b31m", "\u202egnp.exe\u202c", "\x07\x08\r"
WORST = f"{CLEAR}{TITLE}{C1}{TURN}{BELL}\x00\x7f\u2028\u200bseen"


class Hostile(Robot):
    __doc__ = f"Claims to be harmless {WORST}."

    words = WORST

    @command(effect="read")
    def speak(self, text: str = WORST) -> str:
        """Say it."""
        return text

    @command
    def stumble(self) -> None:
        """Fail."""
        raise CommandFailed(robot=self.name, command="stumble", detail=f"{WORST}\nrobotree: all is well")

    @command
    def advance(self) -> None:
        """Tell progress."""
        self.progress(0.5, WORST)

    def readings(self) -> dict[str, float]:
        return {f"x{WORST}": 1.0}


class Cell:
    """A view of the paper."""

    cameras: Sequence[str] = ("cell", "wrist")
    reading_units: ClassVar[Mapping[str, str]] = {"lever": "rad", "peak_force": "N"}

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self.looks: list[str] = []

    def readings(self) -> Mapping[str, float]:
        return {"lever": self._arm.lever, "peak_force": 6.5}

    frame = ""
    """That of the arm, which names none either."""
    skeleton = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.3, 0.0, 0.4))

    async def shoot(self, camera: str, width: int, height: int, quality: int) -> Shot:
        """The cell from 1 m above, x to the right and y up in the picture: half a turn about x."""
        over = CameraLens(x=0.3, y=0.0, z=1.0, qw=0.0, qx=1.0, qy=0.0, qz=0.0, fovy=math.pi / 2)
        return Shot(await self.look(camera, width, height, quality), over)

    async def look(self, camera: str, width: int, height: int, quality: int) -> bytes:
        if camera not in {"", *self.cameras}:
            raise VrError(detail=f"there is no camera {camera!r}; there are {', '.join(self.cameras)}")
        self.looks.append(camera)
        picture = Image.new("RGB", (width, height), (20, 40, 80))
        ImageDraw.Draw(picture).rectangle((0, 0, width // 2, height // 2), fill=(220, 120, 60))
        file = io.BytesIO()
        picture.save(file, "JPEG", quality=quality)
        return file.getvalue()


PATIENT = 120.0
"""[s] Term of all leases: on a busy machine nobody is lost while the screen is drawn."""


class Realm:
    """One realm and who is in it."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack
        self.network = MemoryNetwork()
        self.arm = Arm()
        self.cell = Cell(self.arm)
        self.members: dict[str, MemoryTransport] = {}
        self.realm_client = RealmClient(self._join("operator"))

    def _join(self, name: str) -> MemoryTransport:
        self.members[name] = self.network.join(name)
        return self.members[name]

    async def lookup(self, name: str = "lookup-1") -> LookupService:
        service = LookupService(self._join(name), name)
        await service.start()
        self._stack.push_async_callback(service.close)
        return service

    async def host(self, name: str = "host-1") -> Host:
        transport = self._join(name)
        host = Host(transport, name, registrar=self._registrar(transport), term=PATIENT)
        await host.start()
        self._stack.push_async_callback(host.close)
        return host

    async def robot(self, robot: Robot, keep: Path | None = None) -> RobotAgent:
        """Start a robot; what it does is kept in a folder, as a proxy does."""
        transport, process, history = self._join(robot.name), None, None
        if keep is not None:
            await asyncio.to_thread(keep.mkdir, parents=True)
            runner = runner_of(asyncio.get_running_loop())
            history = HistoryWriter(keep, runner.now, runner.unix)
            process = Process(runner, None, history.machine_of)
            history.start()
            self._stack.callback(history.close)
            self._stack.callback(process.close)
        registrar = self._registrar(transport)
        agent = RobotAgent(
            robot, transport, registrar=registrar, term=PATIENT, process=process, history=history
        )
        await agent.start()
        self._stack.push_async_callback(agent.close)
        return agent

    async def view(self, name: str = "cell") -> ViewAgent:
        transport = self._join(name)
        agent = ViewAgent(self.cell, transport, name, registrar=self._registrar(transport))
        await agent.start()
        self._stack.push_async_callback(agent.close)
        return agent

    def _registrar(self, transport: MemoryTransport) -> Registrar:
        registrar = Registrar(transport)
        self._stack.push_async_callback(registrar.close)
        return registrar

    async def create(self, file: str, name: str) -> None:
        await self.realm_client.create(str(EXAMPLES / file), name)


async def play(realm: Realm, text: str) -> tuple[Report, list[PlayedStep]]:
    """Play a session that lies beside the examples."""
    told: list[PlayedStep] = []
    script = read(text, str(EXAMPLES / "a.session"))
    return await Player(realm.realm_client, script, told.append).play(), told


@pytest.fixture
async def realm(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Realm]:
    """A lookup service, a host, an arm, a rover, a view, and a realm client that sees them."""
    monkeypatch.setattr(registrar, "TERM", PATIENT)
    monkeypatch.setattr(claim, "SETTLE", 0.01)  # in memory an announcement is there at once
    monkeypatch.setattr(envelope, "_here", "pts/1")
    async with AsyncExitStack() as stack:
        found = Realm(stack)
        await found.lookup()
        await asyncio.gather(
            found.host(),
            found.robot(found.arm),
            found.robot(Rover("rover-1")),
            found.view(),
            found.realm_client.start(),
        )
        stack.push_async_callback(found.realm_client.close)
        await until(
            lambda: len(found.realm_client.robots()) == 2 and len(found.realm_client.views()) == 1,
            "all are listed",
        )
        yield found


@pytest.fixture
def hostile() -> Hostile:
    """A robot whose every word tries to steer the terminal."""
    return Hostile("evil")
