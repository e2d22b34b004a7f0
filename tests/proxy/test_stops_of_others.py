"""A stop that the proxy did not ask for, with real processes: the controller's word is shown and obeyed."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robotree.protocol.frame import encode
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    SetMode,
)
from robotree.protocol.parser import Parser
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from robotree.vr.world.testing import until
from tests.command_line import within_realm

pytestmark = pytest.mark.e2e

REALM = "stops"
robotree = within_realm(REALM)
REASON = "its controller is in safe stop: somebody asked for it"


async def shown(*, stopped: bool) -> dict[str, Any]:
    """What `show` tells once it tells that."""
    async with asyncio.timeout(30):
        while True:
            code, out, err = await robotree("show", "rover-1", "--json")
            assert code == exit_codes.DONE, err
            told = json.loads(out)
            if told.get("online", True) and told.get("stopped", False) is stopped:
                return told


class Stranger:
    """Somebody on a link of their own, without a proxy."""

    def __init__(self) -> None:
        self.mode: int | None = None
        self.epoch = 0
        self.obeyed = False
        self._parser = Parser()

    def received(self, data: bytes) -> None:
        for frame in self._parser.feed(data):
            match frame.message:
                case Mode(mode=mode, epoch=epoch):
                    self.mode, self.epoch = mode, epoch
                case CommandAck(result=MavResult.ACCEPTED):
                    self.obeyed = True
                case _:
                    pass

    def closed(self, reason: Exception) -> None:
        pass

    @classmethod
    async def says(cls, url: str, order: CommandLong | SetMode) -> None:
        """Give one order to the controller, in operator control, and leave when it has obeyed."""
        stranger = cls()
        link: Link = await connect(url, lambda _: stranger)
        await until(lambda: stranger.mode is not None, "the controller greets")
        take = command(MavCmd.REQUEST_OPERATOR_CONTROL, 1.0)
        link.send(encode(take, sequence=0, system=254, component=190))
        await until(lambda: stranger.obeyed, "it is in control")
        stranger.obeyed = False
        if isinstance(order, SetMode):
            order = msgspec.structs.replace(order, epoch=stranger.epoch)
        link.send(encode(order, sequence=1, system=254, component=190))
        if isinstance(order, SetMode):
            stop = order.mode == ModeKind.SAFE_STOP
            await until(lambda: (stranger.mode == ModeKind.SAFE_STOP) is stop, "the mode is told")
        else:
            await until(lambda: stranger.obeyed, "the command is acknowledged")
        link.close()


def command(command: MavCmd, param: float) -> CommandLong:
    """As MAVProxy says it: `arm disarm` and its like."""
    return CommandLong(1, 1, command, 0, param, *(0.0,) * 6)


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    """A lookup service and the controller of a rover."""
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lu-1"), ("sim", "rover", "--listen", "tcp:127.0.0.1:0"))
        yield crew


async def test_a_restarted_proxy_finds_its_robot_stopped_and_can_release_it(crew: Crew) -> None:
    proxy = ("proxy", "rover", "rover-1", "--connect", crew.members[1].address)
    first = await crew.start(*proxy)
    await shown(stopped=False)
    assert (await robotree("stop", "rover-1"))[0] == exit_codes.DONE
    os.kill(first.pid, signal.SIGKILL)
    await first.process.wait()
    await crew.start(*proxy)
    assert (await shown(stopped=True))["stop_reason"] == REASON
    portrait = dict(
        line.split(maxsplit=1) for line in (await robotree("show", "rover-1"))[1].splitlines()[:6]
    )
    assert (portrait["state"], portrait["stopped"]) == ("STOPPED", REASON)
    assert "STOPPED" in (await robotree("tree"))[1]
    code, _, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
    assert code != exit_codes.DONE
    assert f"rover-1 is stopped ({REASON}); when it is safe, go on with `robotree resume rover-1`" in said
    assert (await robotree("resume", "rover-1"))[0] == exit_codes.DONE
    assert (await robotree("call", "rover-1.move", "x=0.1", "y=0"))[0] == exit_codes.DONE
    await shown(stopped=False)


async def test_a_stop_over_a_link_of_somebody_else_is_shown_until_it_is_released_there(crew: Crew) -> None:
    url = crew.members[1].address
    await crew.start("proxy", "rover", "rover-1", "--connect", url)
    await shown(stopped=False)
    arm = command(MavCmd.COMPONENT_ARM_DISARM, 1.0)
    for stop, release in (
        (SetMode(0, 0, 0, ModeKind.SAFE_STOP), SetMode(0, 0, 0, ModeKind.READY)),
        (command(MavCmd.COMPONENT_ARM_DISARM, 0.0), arm),
        (command(MavCmd.DO_FLIGHTTERMINATION, 1.0), arm),
    ):
        await Stranger.says(url, stop)
        assert (await shown(stopped=True))["stop_reason"] == REASON
        await Stranger.says(url, release)
        assert "stop_reason" not in await shown(stopped=False)
    code, _, said = await robotree("call", "rover-1.move", "x=0.1", "y=0")
    assert code == exit_codes.DONE, said


async def test_a_stop_of_ours_stays_though_somebody_else_releases_the_robot(crew: Crew) -> None:
    url = crew.members[1].address
    await crew.start("proxy", "rover", "rover-1", "--connect", url)
    await shown(stopped=False)
    await robotree("stop", "rover-1")
    await Stranger.says(url, command(MavCmd.COMPONENT_ARM_DISARM, 1.0))
    stranger = Stranger()
    link = await connect(url, lambda _: stranger)
    await until(lambda: stranger.mode == ModeKind.SAFE_STOP, "it is stopped again")
    link.close()
    assert (await shown(stopped=True))["stop_reason"].endswith("@script's protective stop")
