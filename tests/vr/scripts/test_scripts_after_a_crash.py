"""A host of a script and its partner is killed, at each of its records: the script goes on with its facts."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, Self

from robotree.vr.agents.host import Host
from robotree.vr.bundle import Bundle
from robotree.vr.core.events import CoreEvent
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.outlet import Outlet
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of
from robotree.vr.world.network import MemoryNetwork

TOY = '''
from robotree.vr.author.fields import state
from robotree.vr import command
from robotree.vr.scripts.roles import RolePlayer

class Toy(RolePlayer):
    """Keeps what it has done."""

    done: list[str] = state([])

    @command
    def say(self, text: str) -> str:
        """Say something."""
        self.sleep(0.005)
        said = self.manner.words(text)
        self.done = [*self.done, said]
        return said
'''
DOOR = """
script: door
partners: {robot: Toy}
facts:
  visitor: {who: none}
hears:
  person_seen: {who: text}
rules:
  - rule: begin
    when: [start]
    then:
      - role: {robot: waiter}
  - rule: greet
    when:
      - person_seen: {who: $who}
      - no visitor: {who: $who}
    then:
      - remember: {visitor: {who: $who}}
      - do: [robot, say, "hello $who"]
      - wait: {name: later, for: 30 ms}
  - rule: later
    when: [timer: later]
    then: [do: [robot, say, later]]
  - rule: asked
    when:
      - message: {act: known, performative: request, conversation: $c}
      - visitor: {who: anna}
    then: [reply: [$c, agree, anna]]
"""
ROLE = "role: waiter\nwords: {later: one moment}\n"


AT_ONCE = 8
"""Lives that go on at the same time: each waits for its timers more than it computes."""


class EagerJournal(HostJournal):
    """Writes each record at once, and remembers how long its file was then."""

    ends: list[int]

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        super().append(robot, now, event)
        self.barrier()
        self.ends.append(self.size)

    @property
    def file(self) -> Path:
        return max(Path(self.where).glob("*.log"))

    @property
    def size(self) -> int:
        return self.file.stat().st_size


class Life:
    """One process of the host, from its start to its end."""

    def __init__(self, folder: Path) -> None:
        self.network = MemoryNetwork()
        runner = runner_of(asyncio.get_running_loop())
        self.journal = EagerJournal(folder, runner, boot="this")
        self.journal.ends = []
        self.process: Process[Any] = Process(runner, self.journal)
        self.process.life, self.process.keeps_steps = self.journal.life, True

    async def __aenter__(self) -> Self:
        self.operator = self.network.join("operator")
        outlet = Outlet(self.network.join("host"), self.journal.barrier)
        self.host = Host(outlet, "h1", process=self.process, journal=self.journal)
        await self.host.start()
        await self.host.restore()
        return self

    async def __aexit__(self, *_: object) -> None:
        self.journal.close()
        await self.host.close()
        for transport in list(self.network.members):
            await transport.close()

    def client(self, name: str) -> RobotClient:
        return RobotClient(self.operator, self.host.agents[name].address)

    async def call(self, name: str, command: str, **arguments: Any) -> Any:
        return await self.client(name).call(command, arguments, deadline=600.0, caller="operator")

    def robot(self, name: str) -> Any:
        return self.host.agents[name].robot

    async def until(self, condition: Any) -> None:
        async with asyncio.timeout(120.0):
            while not condition():  # noqa: ASYNC110 # any condition at all
                await asyncio.sleep(0.005)

    async def build(self) -> asyncio.Task[Any]:
        """Make the robots and start the script; returns the running start."""
        hosts = HostClient(self.operator, self.host.address)
        await hosts.create(Bundle(TOY, "toy.py"), "toy")
        await hosts.create(Bundle(DOOR, "door.yaml"), "door")
        await self.call("toy", "learn_role", source=ROLE)
        await self.client("door").enslave("robot", self.host.agents["toy"].address)
        begun = asyncio.ensure_future(self.call("door", "start"))
        await self.until(lambda: self.robot("door")._run is not None)
        return begun


def said(life: Life) -> list[str]:
    return list(life.robot("toy").done)


def at_rest(life: Life) -> bool:
    run = life.robot("door")._run
    return run is not None and run.is_current and not run.under_way


EXPECTED = sorted(["hello anna", "hello bela", "one moment", "one moment"])


async def story(life: Life) -> list[tuple[str, int]]:
    """Play it to its end; return who was acknowledged, and how long the log was then."""
    acknowledged: list[tuple[str, int]] = []
    for who in ("anna", "bela"):
        await life.call("door", "person_seen", who=who)
        acknowledged.append((who, life.journal.size))
    await life.until(lambda: len(said(life)) == len(EXPECTED) and not life.robot("door")._run.under_way)
    return acknowledged


async def whole_log(folder: Path) -> tuple[list[int], list[tuple[str, int]], bytes, str]:
    async with Life(folder) as life:
        begun = await life.build()
        first = life.journal.size
        acknowledged = await story(life)
        file = life.journal.file
        body, ends = file.read_bytes(), [end for end in life.journal.ends if end >= first]
        assert sorted(said(life)) == EXPECTED
        begun.cancel()
    return ends, acknowledged, body, file.name


async def test_after_a_kill_at_any_record_nothing_is_said_twice_and_nothing_is_lost(tmp_path: Path) -> None:
    ends, acknowledged, body, name = await whole_log(tmp_path / "whole")
    assert len(ends) > 20
    room = asyncio.Semaphore(AT_ONCE)

    async def killed_after(number: int, end: int) -> None:
        folder = tmp_path / str(number) / "whole"  # a folder of another name would be a copy
        folder.mkdir(parents=True)
        (folder / name).write_bytes(body[:end])
        async with room, Life(folder) as life:
            known = [who for who, size in acknowledged if size <= end]
            for who in ("anna", "bela"):
                if who not in known or number % 2:  # those that nobody has acknowledged are said again
                    await life.call("door", "person_seen", who=who)
            await life.until(lambda: len(said(life)) >= len(EXPECTED))
            await life.until(lambda: at_rest(life))
            assert sorted(said(life)) == EXPECTED, f"killed after record {number}"
            assert life.robot("toy").role == "waiter"
            assert await life.call("door", "message", act="known", performative="request") == "agree anna"
            await life.call("door", "finish")
            await life.until(lambda: life.robot("door").condition == "ready")
            assert life.robot("door").attributes["ended"] == "finished on request"

    async with asyncio.TaskGroup() as tasks:
        for number, end in enumerate(ends):
            tasks.create_task(killed_after(number, end))
