"""Who commands a controller, with real processes: beside another proxy, over its restart, and nobody."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import os
import shutil
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.protocol import Endpoint, Frame
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    AnyMessage,
    ClaimStatus,
    CommandLong,
    Heartbeat,
    LocalPositionNed,
    MavAutopilot,
    MavCmd,
    MavState,
    MavType,
    Mode,
    ModeKind,
    Reason,
    Tool,
)
from robotree.protocol.parser import Parser
from robotree.protocol.services.fence import LAST_EPOCH
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew, Member
from tests.command_line import within_realm
from tests.ports import free_port
from tests.waiting import until

pytestmark = pytest.mark.e2e

REALM = "commanders"


class Wire:
    """Listens on a link of its own, as anybody."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.heard: list[AnyMessage] = []
        self._reader, self._writer, self._parser = reader, writer, Parser()
        self._listening = asyncio.create_task(self._listen())

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


# -- how soon the arm stands when its proxy is killed, or its line unplugged, while it moves at top speed

LOST = "lost"
FAST = 0.25
"""[m/s] The fastest that the arm goes."""
STANDING = 0.01
"""[m/s]"""
LATEST, FARTHEST = 0.15, 0.025
"""[s], [m] from the end to the arm standing."""
UNREACHED = 2.0
"""[s] from when nobody can reach a proxy: it looks twice a second, and acts when it looks again."""
BEAT = Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)


class Track:
    """The places of the arm, with its own time, 200 times a second."""

    def __init__(self) -> None:
        self.places: list[tuple[float, tuple[float, float, float]]] = []
        self.mode: Mode | None = None

    def hear(self, frame: Frame) -> None:
        message: AnyMessage = frame.message
        if isinstance(message, Tool):
            self.places.append((message.time_boot_ms / 1000, (message.x, message.y, message.z)))
        elif isinstance(message, Mode):
            self.mode = message

    def speed(self) -> float:
        """[m/s] over the last moment."""
        if len(self.places) < 2:
            return 0.0
        (then, there), (now, here) = self.places[-2:]
        return math.dist(there, here) / max(now - then, 0.001)

    def stood(self, since: float) -> tuple[float, float]:
        """How long [s] after a moment it still moved, and how far [m] it was then from where it was."""
        after = [each for each in self.places if each[0] >= since]
        moving = [
            now
            for (then, there), (now, here) in itertools.pairwise(after)
            if math.dist(there, here) / (now - then) >= STANDING
        ]
        way = max(math.dist(after[0][1], place) for _, place in after)
        return (moving[-1] - since if moving else 0.0), way


@asynccontextmanager
async def watching(address: str) -> AsyncIterator[Track]:
    """Listen on a link of its own."""
    track = Track()
    endpoints: list[Endpoint] = []

    def accept(link: Any) -> Endpoint:
        endpoints.append(Endpoint(link, system=77, component=1, on_frame=track.hear))
        return endpoints[0]

    link = await connect(address, accept)
    often = (float(Tool.codec.definition.id), 5000.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    endpoints[0].send(BEAT)
    endpoints[0].send(CommandLong(1, 1, MavCmd.SET_MESSAGE_INTERVAL, 0, *often))
    try:
        yield track
    finally:
        link.close()


async def under_way(track: Track) -> None:
    await until(lambda: track.speed() > 0.9 * FAST, "the arm moves at its top speed")


@pytest.mark.speed
async def test_the_arm_stands_within_150_ms_of_a_kill_of_its_proxy_over_tcp(
    place: Path, record_property: Callable[[str, object], None]
) -> None:
    async with Crew(LOST, place) as crew:
        arm = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0")
        proxy = await crew.start("proxy", "arm", "arm-1", "--connect", arm.address)
        async with joined(LOST) as realm_client, watching(arm.address) as track:
            await realm_client.call(
                "arm-1", "go_to", {"x": 0.45, "y": -0.3, "z": 0.35, "twist": 0, "speed": FAST}
            )
            to = {"x": 0.45, "y": 0.3, "z": 0.35, "twist": 0, "speed": FAST}
            call = asyncio.create_task(realm_client.call("arm-1", "go_to", to, deadline=20))
            await under_way(track)
            killed = track.places[-1][0]
            os.kill(proxy.pid, signal.SIGKILL)
            await until(lambda: track.mode is not None and track.mode.mode == ModeKind.HOLD, "the arm holds")
            await until(lambda: track.places[-1][0] > killed + 0.6, "and is watched")
            call.cancel()
            await asyncio.gather(call, return_exceptions=True)
    seconds, metres = track.stood(killed)
    record_property("standing after [ms], [mm]", (round(1e3 * seconds), round(1e3 * metres, 1)))
    assert track.mode is not None
    assert track.mode.reason == Reason.LINK_SILENT
    assert seconds < LATEST, f"{1e3 * seconds:.0f} ms, {1e3 * metres:.1f} mm"
    assert metres < FARTHEST, f"{1e3 * seconds:.0f} ms, {1e3 * metres:.1f} mm"


async def test_the_arm_stands_when_no_process_can_reach_its_proxy_any_more(place: Path) -> None:
    """The realm's folder is gone and cannot be made again, as after the end of a login session."""
    async with Crew(LOST, place) as crew:
        arm = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0")
        proxy = await crew.start("proxy", "arm", "arm-1", "--connect", arm.address)
        async with watching(arm.address) as track:
            async with joined(LOST) as realm_client:
                await realm_client.call(
                    "arm-1", "go_to", {"x": 0.45, "y": -0.3, "z": 0.35, "twist": 0, "speed": FAST}
                )
                slow = {"x": 0.45, "y": 0.3, "z": 0.35, "twist": 0, "speed": 0.05}
                await realm_client.tell("arm-1", "go_to", slow)
                await until(lambda: track.speed() > 0.03, "the arm moves slowly")
                removed = (place / "robotree").rename(place / "removed")
                (place / "robotree").touch()
                shutil.rmtree(removed)
                gone = track.places[-1][0]
                await until(lambda: track.places[-1][0] > gone + 1.5, "it is watched")
                assert track.speed() > 0.03, "the supervisor can still stop it"
            gone = track.places[-1][0]
            await until(lambda: track.places[-1][0] > gone + 2.5, "nobody is left")
            assert track.speed() < STANDING
            assert "arm-1 ends its commands: no other process can reach it: realm 'lost'" in proxy.log
    seconds, _ = track.stood(gone)
    assert seconds < UNREACHED, f"{seconds:.2f} s"
