"""A realm in virtual time on which the guide is played: a lookup service, a host, arms and rovers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from robotree.proxy.arm import Arm
from robotree.proxy.rover import Rover
from robotree.testing import Fake
from robotree.testing.fake import robot_of
from robotree.tui.line import grammar
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.manual import EVERYWHERE
from robotree.tui.session.playing import Player
from robotree.tui.session.script import read
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.author.robot import Robot
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.running.process import Process
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.world import SimulatedProcess, World
from tests.guide.moved_arm import moved_arm

ROBOTS = {"arm-1": Arm, "arm-2": Arm, "rover-1": Rover, "rover-2": Rover}
SETTLED = 2.0
"""[s] of virtual time for all to be listed."""
LONGEST = 600.0
"""[s] of virtual time for the lines of one chapter."""
ELSEWHERE = {"space", "demo", "new", "check", "stubs", "log", "host", "lookup", "sim", "proxy"}
"""Verbs that are not for scripts: other tests run them."""


class Stage:
    """See the module; what a `Fake` needs of a rehearsal."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.mistake: Exception | None = None
        self.told: list[str] = []
        """What was played, and what came of it."""
        self._realm_client: RealmClient | None = None
        world.start("lookup-1", self._lookup)
        world.start("host-1", self._host)
        for name, kind in ROBOTS.items():
            fake = moved_arm(name) if kind is Arm else Fake(kind, takes=0.2)
            world.start(name, self._robot(robot_of(fake, self, name)))  # type: ignore[arg-type] # enough of one
        self._operator = world.start("operator", self._operate)
        world.run(SETTLED)

    def play(self, lines: list[str], folder: Path) -> None:
        """Play lines as an operator types them into a shell, from a folder."""
        text = "\n".join(filter(None, map(_for_script, lines)))
        self._operator.transport.gate = PolicyFile(folder)  # where a realm keeps its groups
        script = read(text, str(folder / "guide.session"))
        done: list[Any] = []

        async def play() -> None:
            assert self._realm_client is not None
            done.append(
                await Player(self._realm_client, script, lambda told: self.told.append(str(told))).play()
            )

        self._operator.do(play, "play")
        began = self.world.runner.now()
        while not done and self.world.runner.now() < began + LONGEST:
            self.world.run(self.world.runner.now() + 0.1)
        assert done, "\n".join(self.told)
        assert done[0].ok, "\n".join(self.told[-3:])

    async def _lookup(self, process: SimulatedProcess) -> None:
        await LookupService(process.transport, "lookup-1").start()
        await asyncio.Event().wait()

    async def _host(self, process: SimulatedProcess) -> None:
        registrar = Registrar(process.transport)
        await Host(process.transport, "host-1", registrar=registrar, process=Process(process.runner)).start()
        await asyncio.Event().wait()

    def _robot(self, robot: Robot) -> Callable[[SimulatedProcess], Coroutine[Any, Any, None]]:
        async def live(process: SimulatedProcess) -> None:
            registrar = Registrar(process.transport)
            await RobotAgent(
                robot, process.transport, registrar=registrar, process=Process(process.runner)
            ).start()
            await asyncio.Event().wait()

        return live

    async def _operate(self, process: SimulatedProcess) -> None:
        self._realm_client = RealmClient(process.transport)
        await self._realm_client.start()
        await asyncio.Event().wait()


def _for_script(line: str) -> str:
    """Return a line of a shell as a script has it; empty: it is for the shell alone."""
    command, _, remark = line.partition("  #")
    words = command.removeprefix("robotree ").strip()
    if not line.startswith("robotree ") or words.split()[0] in ELSEWHERE or "--watch" in words:
        return ""
    parsed = grammar.parse(grammar.split(words), shapes(Where.SHELL), EVERYWHERE)
    assert parsed.verb
    words = words.replace(" --trace", "").replace(" --detach", "")
    return f"try {words}" if "refused" in remark else words
