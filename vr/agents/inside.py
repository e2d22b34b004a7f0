"""The program of a robot in a process of its own: a host of one robot, whose only way out is the pipe.

`PipeMesh` has the surface of `network.mesh.Mesh`, so `LocalTransport` and everything above it run unchanged.
What the robot does not ask of itself goes to the host, which judges it.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import shutil
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
from msgspec.structs import replace

from robotree.files import private_folder
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.agents.placing import Placeable
from robotree.vr.agents.run import kept_by, kept_in, place_of
from robotree.vr.base.address import mark
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import PermitRefused, VrError
from robotree.vr.base.pattern import matches
from robotree.vr.base.permissions import Isolation, Permissions
from robotree.vr.base.permit import PermittedCall, unfit
from robotree.vr.base.policy import Person, PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.presence import Held, Presence
from robotree.vr.base.principal import ITSELF, Credentials, Principal
from robotree.vr.base.requests import Described, SafeStop, encode
from robotree.vr.base.system import System
from robotree.vr.base.transport import ELSEWHERE, Occupied, OnReply
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Clearance, Gate
from robotree.vr.core.machine import RobotCore
from robotree.vr.exchange.authority import authorise
from robotree.vr.exchange.dispatcher import refusal
from robotree.vr.isolation import pipe
from robotree.vr.isolation.confine import confine, end_with_parent
from robotree.vr.isolation.pipe import RobotPipe
from robotree.vr.journal.store import own
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.local import LocalTransport
from robotree.vr.network.mesh import TakeFrame
from robotree.vr.orders.ledger import ORDERS, Ledger
from robotree.vr.running.heard import listening
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of, soon

BEAT = 0.5
"""[s] between two signs of life."""
SAYS_WITHIN = 2.0
"""[s] for a robot that has moved or was deleted to tell who waits for that."""
ROOM = "room"
"""Name of the folder for files that nobody keeps, in that of the robot."""


class PipeMesh:
    """See the module. Every method may be called from any thread."""

    def __init__(self, way: RobotPipe, begin: pipe.BeginFrame) -> None:
        """Take the pipe, and what the host has said first."""
        self.place = SimpleNamespace(system=_System(begin), realm=begin.realm)
        self._pipe = way
        self._host = Credentials(begin.process, begin.user)
        self._held: list[Held] = []
        self.presence = Presence(held=lambda _: [], unheard=self._unheard)
        self.gate = GateInside()
        self._take_rules(begin.rules)
        self._servers: dict[str, TakeFrame] = {}
        self._asked: dict[int, OnReply] = {}
        self._handlers: dict[int, Callable[[str, bytes], None]] = {}
        self._waiting: dict[int, Callable[[list[str]], None]] = {}
        self._numbers = itertools.count(1)
        self._closed: Future[None] = Future()
        self.takers: dict[type[pipe.PipeFrame], Callable[[Any], object]] = {
            pipe.Come: self._come,
            pipe.Replied: self._take_reply,
            pipe.Sampled: self._take_sample,
            pipe.Present: lambda news: self.presence.count(news.key, there=news.there, left=news.left),
            pipe.Silent: self._take_silent,
            pipe.Rules: self._take_rules,
            pipe.Did: self._take_done,
        }
        """What takes each frame, in the thread that reads; of those for the robot it is set by `_live`."""

    # -- what LocalTransport uses -----------------------------------------------------------------

    def serve(self, key: str, take: TakeFrame, *, rank: int = 0) -> None:
        self._servers[key] = take
        self._send(pipe.Serve(key, on=True, rank=rank))

    def end_serving(self, key: str) -> None:
        """Answer no more requests under a key."""
        if self._servers.pop(key, None) is not None:
            self._send(pipe.Serve(key, on=False, rank=0))

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        number = next(self._numbers)
        self._asked[number] = on_reply
        self._send(pipe.Ask(number, key, body, void_at, urgent))

    def after_reading(self, job: Callable[[], bool]) -> bool:
        del job
        return False

    def publish(self, key: str, body: bytes) -> None:
        self._send(pipe.Publish(key, body))

    def subscribe(self, pattern: str, handler: Callable[[str, bytes], None]) -> int:
        number = next(self._numbers)
        self._handlers[number] = handler
        self._send(pipe.Subscribe(number, pattern))
        return number

    def unsubscribe(self, number: int) -> None:
        """Take no more samples."""
        self._handlers.pop(number, None)
        self._send(pipe.Unsubscribe(number))

    def announce(self, key: str, *, unless: Sequence[str] = ()) -> None:
        """Announce; waits for the host, which is near.

        Raises:
            Occupied: others are present.
        """
        number, answer = next(self._numbers), Future[list[str]]()
        self._waiting[number] = answer.set_result
        self._send(pipe.Announce(number, key, list(unless)))
        if others := answer.result():
            raise Occupied(others)

    def withdraw(self, key: str) -> None:
        """Be present no longer."""
        self._send(pipe.Withdraw(key))

    def settle(self, on_settled: Callable[[], None]) -> None:
        number = next(self._numbers)
        self._waiting[number] = lambda _: on_settled()
        self._send(pipe.Settle(number))

    def watch_itself(self, handler: Callable[[str], None]) -> int:
        """Watch nothing: a robot whose host cannot be reached has the host end its bonds."""
        del handler
        return 0

    def unwatch(self, number: int) -> None:
        """See `watch_itself`."""

    def close(self) -> Future[None]:
        if not self._closed.done():
            self._closed.set_result(None)
        return self._closed

    # -- what comes -------------------------------------------------------------------------------

    def read(self) -> None:
        """Take frames until the host has gone; then this process ends, whatever it does."""
        with contextlib.suppress(OSError, msgspec.MsgspecError):
            while (frame := self._pipe.receive()) is not None:
                if (take := self.takers.get(type(frame))) is not None:  # else the robot is not up yet
                    take(frame)
        os._exit(0)

    def _take_reply(self, frame: pipe.Replied) -> None:
        on_reply = (
            self._asked.pop(frame.number, None) if frame.body is None else self._asked.get(frame.number)
        )
        if on_reply is not None:
            on_reply(frame.body)

    def _take_sample(self, frame: pipe.Sampled) -> None:
        if (handler := self._handlers.get(frame.number)) is not None:
            handler(frame.key, frame.body)

    def _take_silent(self, frame: pipe.Silent) -> None:
        self._held = frame.held

    def _take_rules(self, frame: pipe.Rules) -> None:
        gate = self.gate
        gate.trouble, gate.site, gate.person = frame.trouble, frame.site, frame.person
        gate.roles, gate.owner = frame.roles, frame.owner
        mark(frame.user)
        gate.policy = read_policy(frame.text) if frame.text else None

    def _take_done(self, frame: pipe.Did) -> None:
        if (answer := self._waiting.pop(frame.number, None)) is not None:
            answer(frame.others)

    def _come(self, frame: pipe.Come) -> None:
        number = frame.number
        take = next(iter(self._servers.values()), None)
        if take is None:
            self._send(pipe.EndBack(number, ELSEWHERE))  # the host knows whether it has moved
            return
        take(
            frame.body,
            Credentials(frame.process, frame.user),
            frame.urgent,
            lambda body: self._send(pipe.ReplyBack(number, bytes(body))),
            lambda body: self._send(pipe.EndBack(number, None if body is None else bytes(body))),
        )

    def _unheard(self, pattern: str) -> list[tuple[Held, bool]]:
        return [(held, True) for held in self._held if matches(pattern, held.key)]

    def _send(self, frame: pipe.PipeFrame) -> None:
        try:
            self._pipe.send(frame)
        except OSError:
            os._exit(0)  # the host has gone


class GateInside(PolicyGate):
    """The policy inside: the host brings it, and the permits of calls."""

    apart = True

    def expect_permit(self, asker: Person, call: PermittedCall) -> None:
        reason = "there is none"
        if call.vouched is not None:
            reason = unfit(call.vouched, asker.assistant, call, time.time())
        if reason:
            raise PermitRefused(permit=call.permit or "none", reason=reason)


class _System(System):
    """The machine, with the process that others see: the host."""

    def __init__(self, begin: pipe.BeginFrame) -> None:
        self._process, self._user = begin.process, begin.user

    def pid(self) -> int:
        return self._process

    def user(self) -> int:
        return self._user

    def at_exit(self, work: Callable[[], object]) -> None:
        """Leave nothing behind, so nothing is to be done."""

    def not_at_exit(self, work: Callable[[], object]) -> None:
        """See `at_exit`."""


def main(descriptor: int, parent: int) -> None:
    """Be the robot for which the host asks through this socket, until the robot or the host ends."""
    end_with_parent(parent)
    way = RobotPipe(socket.socket(fileno=descriptor))
    begin = way.receive()
    if not isinstance(begin, pipe.BeginFrame):
        os._exit(0)
    room = _room(begin.folder)
    lacks = confine([*begin.writable, room])
    mesh = PipeMesh(way, begin)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_live(way, mesh, begin, lacks))
    os._exit(0)


def _room(folder: str) -> str:
    """Return a folder for files that nobody keeps, in the robot's own; it is empty."""
    if folder:
        room = Path(folder, ROOM)
        shutil.rmtree(room, ignore_errors=True)
        private_folder(room)
        tempfile.tempdir = str(room)
    else:
        tempfile.tempdir = tempfile.mkdtemp(prefix="robotree-apart-")
    return tempfile.tempdir


async def _live(way: RobotPipe, mesh: PipeMesh, begin: pipe.BeginFrame, lacks: list[str]) -> None:
    """Make the robot, or have it go on, and let it live."""
    loop = asyncio.get_running_loop()
    leaving: asyncio.Future[bool] = loop.create_future()

    def leave(returns: bool) -> None:  # noqa: FBT001 # a flag of the frame
        if not leaving.done():
            leaving.set_result(returns)

    mesh.takers[pipe.Leave] = lambda frame: soon(loop, partial(leave, frame.returns))
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(listening())
        parcel: asyncio.Future[pipe.Parcel] = loop.create_future()
        mesh.takers[pipe.Arrive] = lambda frame: soon(loop, partial(parcel.set_result, frame.parcel))
        if begin.parcel is not None:
            parcel.set_result(begin.parcel)
        threading.Thread(target=mesh.read, name="reader", daemon=True).start()
        try:
            host = _host(mesh, begin, stack)
            agent = await _come_up(host, begin, way, parcel)
        except Exception as error:  # noqa: BLE001 # the host is told, and tells who has asked
            way.send(pipe.FailedFrame(encode(refusal(error, begin.name))))
            return
        for lack in (*lacks, *filter(None, (begin.note,))):
            agent.runtime.log.say("warning", lack)
        mesh.takers[pipe.Control] = partial(_control, loop, host, way)
        way.send(pipe.Up(encode(Described(robot=agent.description())), host.page_of(begin.name)))
        place = host.placeables()[agent.address.key]
        mesh.takers[pipe.Place] = lambda frame: soon(loop, partial(_take_place, place, frame))
        beats = loop.create_task(_beat(way, host, place))
        gone = loop.create_task(agent.closed.wait())
        both: tuple[asyncio.Future[Any], ...] = (leaving, gone)
        done, _ = await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        beats.cancel()
        if leaving in done:
            await host.close(returns=leaving.result())
        else:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(SAYS_WITHIN):
                    await asyncio.gather(*map(asyncio.wrap_future, tuple(tasks)), return_exceptions=True)
            way.send(pipe.GoneFrame())
            await host.close(returns=False)


class _Admitted(Gate):
    """The gate inside: the host has decided already."""

    def __init__(self, permissions: Permissions | None, level: Isolation) -> None:
        super().__init__()
        self.level = level
        self._given = Clearance(permissions=permissions)

    def admit(self, bundle: Bundle, asker: Principal, host: str) -> Clearance:
        """See `Gate.admit`."""
        del bundle, asker, host
        return self._given


def _host(mesh: PipeMesh, begin: pipe.BeginFrame, stack: contextlib.AsyncExitStack) -> Host:
    runner = runner_of(asyncio.get_running_loop())
    transport: Any = LocalTransport(mesh)  # type: ignore[arg-type] # it has what is used of a `Mesh`
    transport.gate = mesh.gate
    folder = Path(begin.folder) if begin.folder else None
    place = place_of(folder, "", begin.name)
    log = None if place is None else own(place, begin.host)
    journal, history = kept_in(log, folder, runner, stack)
    process: Process[Any] = Process(runner, journal, history.machine_of if history else RobotCore)
    if journal is not None:
        transport = kept_by(journal, process, transport, begin.returns)
    ledger = None if folder is None else Ledger(folder / ORDERS)
    if ledger is not None:
        stack.callback(ledger.close)
    host = Host(
        transport,
        begin.host,
        registrar=Registrar(transport),
        term=begin.term,
        limit=begin.limit,
        process=process,
        only=begin.name,
        journal=journal,
        gate=_Admitted(begin.permissions, begin.level),
        ledger=ledger,
    )
    host.opens()
    if history is not None:
        host.keeps_history(history)
    return host


async def _come_up(
    host: Host, begin: pipe.BeginFrame, way: RobotPipe, parcel: asyncio.Future[pipe.Parcel]
) -> RobotAgent:
    """Make the robot, or have it go on; one that comes from another host when it is here."""
    await host.restore(abandon=begin.abandon, left=begin.left)
    if begin.name in host.agents:  # the process before had it, or had taken it in
        return host.agents[begin.name]
    if begin.create is None:
        raise VrError(detail=f"{begin.name} is not back: its log says why")
    if not begin.arrives:
        return await host.make(begin.create, begin.asker)
    loaded = await host.load(begin.create, begin.name, begin.asker)
    way.send(pipe.Loaded())
    came = await parcel
    for stop in (order for order in begin.left if isinstance(order, SafeStop)):
        came = replace(came, sent=replace(came.sent, stopped=stop.reason, order=stop.order))
    return await host.moves.take_in(loaded, came)


def _control(loop: asyncio.AbstractEventLoop, host: Host, way: RobotPipe, frame: pipe.Control) -> None:
    async def answer() -> None:
        try:
            host.gate = _Admitted(frame.permissions, host.gate.level)
            if frame.principal != ITSELF:  # of the host
                authorise(frame.principal, frame.request, None, host.here)
            received = Received(frame.request, frame.principal, loop.time(), 60.0)
            body = encode(await host.answer(received))
        except Exception as error:  # noqa: BLE001 # the asker gets an answer
            body = encode(refusal(error, host.address.name))
        way.send(pipe.Answered(frame.number, body))

    tasks.add(task := asyncio.run_coroutine_threadsafe(answer(), loop))
    task.add_done_callback(tasks.discard)


tasks: set[Future[None]] = set()
"""Answers that are being made."""


def _take_place(place: Placeable, frame: pipe.Place) -> None:
    """Note what the host has found of the robot's place."""
    with contextlib.suppress(VrError):  # it is on its way already
        match frame.does:
            case "show":
                place.show(frame.advice, frame.text)
            case "begin_move":
                place.begin_move(frame.advice)
            case "end_move":
                place.end_move(frame.advice, frame.text)


async def _beat(way: RobotPipe, host: Host, place: Placeable) -> None:
    while True:
        abandoned = [name for agent in list(host.agents.values()) for name in agent.abandoned]
        target = next((departure.target for departure in host.moves.leaving.values()), "")
        way.send(pipe.Alive(abandoned, target, place.placed, place.came))
        await asyncio.sleep(BEAT)


if __name__ == "__main__":
    main(int(sys.argv[1]), os.getppid())
