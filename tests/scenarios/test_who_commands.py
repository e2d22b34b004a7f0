"""Who commands a controller, with real processes: beside another proxy, over its restart."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from robotree.protocol.messages import (
    AnyMessage,
    ClaimStatus,
    LocalPositionNed,
    Mode,
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
