"""The threads that read the network: what they carry out keeps nobody from being heard."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import CommandCancelled
from robotree.vr.base.principal import Credentials
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.readers import READERS
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.world.testing import Join

SOON = 60.0
"""[s] that a test waits at most for what should come at once."""

Ask = Callable[..., threading.Event]


class Server:
    """A mesh that answers; the answer to `long` waits for `go`, in the thread that has read the request."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.go = threading.Event()
        self.at_work = threading.Semaphore(0)
        self.heard: list[bytes] = []
        self.usable = True
        """Whether a thread that has carried something out can be used again."""
        mesh.serve("server", self.answer)

    def answer(
        self,
        body: bytes,
        _credentials: Credentials,
        urgent: bool,  # noqa: FBT001 # a `mesh.TakeFrame`
        _: Callable[[bytes], None],
        end: Callable[[bytes | None], None],
    ) -> None:
        del urgent
        self.heard.append(body)
        if not body.startswith(b"long"):
            end(body)
            return

        def job() -> bool:
            self.at_work.release()
            if body == b"long":
                self.go.wait(SOON)
            end(body)
            return self.usable

        if not self.mesh.after_reading(job):
            threading.Thread(target=job, daemon=True).start()  # as a pool would


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    mesh = Mesh(Rendezvous("test", tmp_path / "r"))
    mesh.open()
    server = Server(mesh)
    yield server
    server.go.set()
    mesh.close().result(SOON)


@pytest.fixture
def ask(server: Server, tmp_path: Path) -> Iterator[Ask]:
    """Ask the server; returns an event that is set when all replies are there."""
    mesh = Mesh(Rendezvous("test", tmp_path / "r"))
    mesh.open()

    def ask(body: bytes, *, urgent: bool = False) -> threading.Event:
        done = threading.Event()
        mesh.ask("server", body, urgent=urgent, on_reply=lambda reply: reply is None and done.set())
        return done

    assert server.mesh is not mesh
    yield ask
    mesh.close().result(SOON)


def wait_for_work(server: Server, commands: int) -> None:
    for _ in range(commands):
        assert server.at_work.acquire(timeout=SOON)


def test_a_stop_is_read_while_every_reader_is_in_a_command(server: Server, ask: Ask) -> None:
    commands = []
    for number in range(1, 6):
        commands.append(ask(b"long"))
        wait_for_work(server, 1)
        assert ask(b"stop", urgent=True).wait(SOON), f"{number} commands keep a stop from being read"
        assert ask(b"question").wait(SOON)
    assert not any(command.is_set() for command in commands)
    server.go.set()
    assert all(command.wait(SOON) for command in commands)


def test_requests_over_one_connection_are_taken_in_their_order_whichever_thread_reads_them(
    server: Server, ask: Ask
) -> None:
    bodies = [b"long %d" % number if number % 5 else b"%d" % number for number in range(2000)]
    asked = [ask(body) for body in bodies]
    assert all(one.wait(SOON) for one in asked)
    assert server.heard == bodies


def test_a_reader_that_is_lost_in_a_command_is_replaced(server: Server, ask: Ask) -> None:
    server.usable = False
    before = threading.active_count()
    for number in range(20):
        assert ask(b"long %d" % number).wait(SOON)
        assert ask(b"stop", urgent=True).wait(SOON)
    assert threading.active_count() <= before + 2 * READERS, "each one lost leaves one behind"


def test_readers_that_have_nothing_to_do_end_but_for_two(server: Server, ask: Ask) -> None:
    commands = [ask(b"long") for _ in range(6)]
    wait_for_work(server, 6)
    server.go.set()
    assert all(command.wait(SOON) for command in commands)
    latest = time.monotonic() + SOON
    while (left := server.mesh._readers.count) != READERS:
        assert time.monotonic() < latest, f"{left} readers are left"
        time.sleep(0.001)


def test_a_mesh_closes_while_its_readers_are_in_commands(server: Server, ask: Ask) -> None:
    for _ in range(3):
        ask(b"long")
    wait_for_work(server, 3)
    server.mesh.close().result(SOON)
    assert not server.go.is_set()


def test_no_thread_carries_out_what_it_has_not_read(server: Server) -> None:
    assert not server.mesh.after_reading(lambda: True)


class Stubborn(Robot):
    """Its command computes and never waits."""

    begun: threading.Event
    enough: threading.Event

    @command
    def compute(self) -> None:
        """Compute on and on, and look up only now and then."""
        self.begun.set()
        while not self.enough.is_set():
            self.sleep(0)


async def test_robots_at_work_on_what_their_readers_brought_stop_at_once(join_realm: Join) -> None:
    here, there = await join_realm(), await join_realm()
    agents = []
    for number in range(4):
        robot = Stubborn(f"stubborn-{number}")
        robot.begun, robot.enough = threading.Event(), threading.Event()
        agents.append(RobotAgent(robot, there))
        await agents[-1].start()
    clients = [RobotClient(here, agent.address) for agent in agents]
    calls = [asyncio.ensure_future(client.call("compute", {})) for client in clients]
    for agent in agents:
        assert isinstance(agent.robot, Stubborn)
        assert await asyncio.to_thread(agent.robot.begun.wait, SOON)
    for client, call in zip(clients, calls, strict=True):
        assert await client.safe_stop("enough") == (client.address.name,)
        with pytest.raises(CommandCancelled, match="enough"):
            await call
    for agent in agents:
        await agent.close()
