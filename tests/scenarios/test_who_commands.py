"""Who commands a controller, with real processes: behind a router, beside another proxy, over its restart."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from robotree.protocol.frame import Frame, encode
from robotree.protocol.messages import (
    AnyMessage,
    ClaimStatus,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    Heartbeat,
    LocalPositionNed,
    MavAutopilot,
    MavState,
    MavType,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.parser import Parser
from robotree.protocol.services.fence import LAST_EPOCH
from robotree.proxy.translate import component_of
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew, Member
from tests.command_line import within_realm
from tests.ports import free_port
from tests.waiting import until

pytestmark = pytest.mark.e2e

REALM = "commanders"
NAN = float("nan")
BEAT = Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
GROUND_STATION, NAMESAKE = (255, 190), (255, component_of("rover-1"))


class Wire:
    """Speaks and listens on a link of its own, as anybody."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.heard: list[AnyMessage] = []
        self._reader, self._writer, self._parser = reader, writer, Parser()
        self._listening = asyncio.create_task(self._listen())

    def say(self, message: AnyMessage, speaker: tuple[int, int] = GROUND_STATION) -> None:
        self._writer.write(encode(message, sequence=0, system=speaker[0], component=speaker[1]))

    def last(self, kind: type[AnyMessage]) -> AnyMessage | None:
        return next((each for each in reversed(self.heard) if isinstance(each, kind)), None)

    @property
    def mode(self) -> Mode:
        found = self.last(Mode)
        assert isinstance(found, Mode)
        return found

    @property
    def holder(self) -> str:
        """Who holds the claim and is heard from."""
        found = self.last(ClaimStatus)
        return found.name if isinstance(found, ClaimStatus) and found.holder_system else ""

    @property
    def x(self) -> float:
        found = self.last(LocalPositionNed)
        return found.x if isinstance(found, LocalPositionNed) else 0.0

    async def _listen(self) -> None:
        while data := await self._reader.read(65536):
            self.heard += [frame.message for frame in self._parser.feed(data)]

    async def close(self) -> None:
        self._listening.cancel()
        self._writer.close()


@asynccontextmanager
async def wire(port: int) -> AsyncIterator[Wire]:
    it = Wire(*await asyncio.open_connection("127.0.0.1", port))
    try:
        await until(lambda: it.last(Mode) is not None, "the controller greets")
        yield it
    finally:
        await it.close()


class Router:
    """Joins all who dial it with one controller, over one link to it, as mavlink-router does.

    The controller cannot see that one of them has gone.
    """

    def __init__(self, controller: int) -> None:
        self._controller = controller
        self.passes: Callable[[Frame], bool] = lambda _: True
        """Whether a frame of the controller is let through."""
        self.clients: set[asyncio.StreamWriter] = set()
        self._up: asyncio.StreamWriter | None = None

    async def run(self) -> None:
        """Keep one link to the controller, and dial it again."""
        while True:
            with contextlib.suppress(OSError):
                reader, self._up = await asyncio.open_connection("127.0.0.1", self._controller)
                with contextlib.closing(self._up):
                    await self._pass_down(reader)
            self._up = None
            await asyncio.sleep(0.02)

    async def _pass_down(self, reader: asyncio.StreamReader) -> None:
        parser = Parser()
        while data := await reader.read(65536):
            kept = [frame.raw for frame in parser.feed(data) if self.passes(frame)]
            for client in self.clients:
                client.write(b"".join(kept))

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.clients.add(writer)
        parser = Parser()
        try:
            with contextlib.suppress(ConnectionError):
                while data := await reader.read(65536):
                    for frame in parser.feed(data):
                        if self._up is not None:
                            self._up.write(frame.raw)
        finally:
            self.clients.discard(writer)
            writer.close()


@asynccontextmanager
async def routing(controller: int) -> AsyncIterator[tuple[Router, int]]:
    router = Router(controller)
    server = await asyncio.start_server(router.serve, "127.0.0.1", 0)
    running = asyncio.create_task(router.run())
    try:
        yield router, server.sockets[0].getsockname()[1]
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        for client in router.clients:
            client.close()
        server.close()


async def robotree(*words: str) -> tuple[int, str]:
    """Run a verb to its end; exit code and all that it said."""
    code, out, complaints = await within_realm(REALM)(*words)
    return code, out + complaints


async def end(member: Member, number: int) -> None:
    os.kill(member.pid, number)
    await member.process.wait()


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    async with Crew(REALM, place) as crew:
        yield crew


async def rover(crew: Crew, port: int, place: Path, *words: str) -> Member:
    state = ("--state", str(place / "fence.json"))
    return await crew.start("sim", "rover", "--listen", f"tcp:127.0.0.1:{port}", *state, *words)


async def proxy(crew: Crew, port: int, name: str = "rover-1", *words: str) -> Member:
    return await crew.start("proxy", "rover", name, "--connect", f"tcp:127.0.0.1:{port}", *words)


async def test_no_heartbeat_of_anybody_else_hides_that_a_proxy_was_killed(crew: Crew, place: Path) -> None:
    port = free_port()
    await rover(crew, port, place)
    async with routing(port) as (_, routed), wire(routed) as station:
        commander = await proxy(crew, routed)
        call = asyncio.create_task(robotree("call", "rover-1.move", "x=1.4", "y=0", "speed=0.2"))
        await until(lambda: station.x > 0.1 or call.done(), "it moves")
        assert not call.done(), await call
        await end(commander, signal.SIGKILL)
        was = station.x

        def stands() -> bool:
            for speaker in (GROUND_STATION, NAMESAKE):
                station.say(BEAT, speaker)
            return station.mode.mode != ModeKind.ACTIVE

        await until(stands, "its motion ends")
        assert (station.mode.mode, station.mode.reason) == (ModeKind.HOLD, Reason.LINK_SILENT)
        assert station.x - was < 0.2 * 3.0, "not later than a second after the silence that it bears"
        assert (await call)[0] != exit_codes.DONE


@pytest.mark.parametrize(
    "delay", [0.1, *(pytest.param(each, marks=pytest.mark.soak) for each in (0.0, 0.3, 0.6, 0.9, 1.2))]
)
async def test_a_move_whose_status_is_lost_is_not_carried_out_again_by_a_restarted_controller(
    crew: Crew, place: Path, delay: float
) -> None:
    port = free_port()
    controller = await rover(crew, port, place)
    async with routing(port) as (router, routed), wire(routed) as watcher:
        await proxy(crew, routed)
        router.passes = lambda frame: not isinstance(frame.message, GoalStatus)
        call = asyncio.create_task(robotree("call", "rover-1.move", "x=0.8", "y=0", "speed=0.4"))
        await until(lambda: watcher.x > 0.05 or call.done(), "it moves")
        assert not call.done(), await call
        await asyncio.sleep(delay)
        await end(controller, signal.SIGKILL)
        watcher.heard.clear()
        await rover(crew, port, place)
        router.passes = lambda _: True
        code, said = await call
        assert code == exit_codes.REFUSED
        assert "rover-1.move may have been carried out or not" in said
        assert "Look where the robot is before you give it again" in said
        await until(lambda: watcher.last(LocalPositionNed) is not None, "the new life tells where it is")
        assert all(abs(each.x) < 0.01 for each in watcher.heard if isinstance(each, LocalPositionNed))
        code, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
        assert code == exit_codes.DONE, said


async def test_a_second_proxy_is_refused_by_the_controller_until_it_takes_over(
    crew: Crew, place: Path
) -> None:
    port = free_port()
    controller = await rover(crew, port, place)
    first, _ = await proxy(crew, port), await proxy(crew, port, "rover-2")
    call = asyncio.create_task(robotree("call", "rover-1.move", "x=1.2", "y=0", "speed=0.05"))
    async with wire(port) as watcher:
        await until(lambda: watcher.x > 0.02, "it moves")
        code, said = await robotree("call", "rover-2.move", "x=0.1", "y=0")
        assert code == exit_codes.REFUSED
        assert f"'rover-1, pid {first.pid}' holds its controller; end that program, or start this" in said
        assert not call.done()
        assert f"rover-1, pid {first.pid}" in (await robotree("show", "rover-2"))[1]
        third = await proxy(crew, port, "rover-3", "--take-over")
        code, said = await call
        assert code != exit_codes.DONE
        assert f"rover-3, pid {third.pid} commands this robot from now on" in said
        code, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
        assert (code, f"'rover-3, pid {third.pid}' holds" in said) == (exit_codes.REFUSED, True)
        await end(controller, signal.SIGKILL)
    await rover(crew, port, place)
    async with wire(port) as watcher:
        await until(lambda: watcher.holder.startswith("rover-3"), "its holder is back")
    code, said = await robotree("call", "rover-3.move", "x=0.1", "y=0")
    assert code == exit_codes.DONE, said
    code, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
    assert code == exit_codes.REFUSED, "nobody slips in while the controller restarts"
    assert f"rover-3: took its controller over from 'rover-1, pid {first.pid}' (--take-over)" in third.log
    assert f"rover-1: 'rover-3, pid {third.pid}' holds its controller" in first.log


async def test_frames_with_an_epoch_near_the_end_lock_nobody_out(crew: Crew, place: Path) -> None:
    port = free_port()
    await rover(crew, port, place)
    async with wire(port) as fool:
        for epoch in (2**32 - 1, LAST_EPOCH, LAST_EPOCH - 1):
            fool.say(Goal(9, epoch, 0, (0.1, 0.0, *(NAN,) * 5), Verb.MOVE, 1, 1))
            fool.say(GoalCancel(0, epoch, 1, 1))
            fool.say(SetMode(epoch, 1, 1, ModeKind.READY))
        await until(lambda: sum(isinstance(each, GoalStatus) for each in fool.heard) == 6, "it answers")
        statuses = [each for each in fool.heard if isinstance(each, GoalStatus)]
        assert {(each.state, each.reason) for each in statuses} == {(GoalState.REFUSED, Reason.BAD_EPOCH)}
        assert fool.mode.epoch == 0
        await proxy(crew, port)
        code, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
        assert code == exit_codes.DONE, said


async def test_whose_controller_has_no_epoch_left_follows_the_advice_and_drives(
    crew: Crew, place: Path
) -> None:
    port = free_port()
    (place / "fence.json").write_text(json.dumps({"epoch": LAST_EPOCH, "holder": 0, "name": "", "life": 7}))
    controller = await rover(crew, port, place)
    await proxy(crew, port)
    code, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
    assert code == exit_codes.REFUSED
    assert "reset it at its machine: robotree sim … --reset-epoch" in said
    await end(controller, signal.SIGTERM)
    await rover(crew, port, place, "--reset-epoch")
    async with wire(port) as watcher:
        await until(lambda: watcher.holder.startswith("rover-1"), "the proxy is back")
        await until(lambda: watcher.mode.epoch > 0, "the controller reports the epoch of the claim")
        assert watcher.mode.epoch < LAST_EPOCH
    code, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
    assert code == exit_codes.DONE, said
