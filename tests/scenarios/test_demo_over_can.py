"""The demo over a CAN bus: the same cast, the same lever, and anybody on the bus can listen."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import AsyncGenerator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import can
import pytest

from robotree.client.joining import joined
from robotree.protocol.canbus.membership import first_port
from robotree.protocol.links.can.address import read
from robotree.protocol.links.url import parse
from robotree.tui import exit_codes
from robotree.tui.demo import Wire, cast
from robotree.tui.processes.crew import Crew
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.command_line import robotree

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300), pytest.mark.usefixtures("place")]


@asynccontextmanager
async def playing(wire: Wire, folder: Path) -> AsyncGenerator[RealmClient]:
    """The demo's own cast, on a bus of this process alone."""
    realm = name(wire)
    async with Crew(realm, folder) as crew:
        await cast(crew, wire=wire, speedup="3")
        async with joined(realm) as realm_client:
            await until(
                lambda: len(realm_client.robots()) == 2 and len(realm_client.views()) == 1,
                "the cast is listed",
            )
            async with asyncio.timeout(60):
                for robot in ("arm-1", "rover-1"):
                    while not (await realm_client.describe(robot)).online:  # noqa: ASYNC110  an answer has no event
                        await asyncio.sleep(0.02)
            yield realm_client


def name(wire: Wire) -> str:
    """The realm."""
    return f"can-{os.getpid()}-{wire.name.lower()}"


def channel(wire: Wire) -> str:
    """The channel of the bus."""
    return f"demo-{name(wire)}"


@pytest.fixture
def listeners() -> Iterator[Any]:
    """Members of a bus that only listen, as candump does."""
    opened: list[can.BusABC] = []

    def listen(channel: str) -> can.BusABC:
        opened.append(can.Bus(interface="robotree", channel=channel))
        return opened[-1]

    yield listen
    for bus in opened:
        bus.shutdown()


def heard(bus: can.BusABC) -> list[can.Message]:
    """What has come so far."""
    messages: list[can.Message] = []
    while (message := bus.recv(0)) is not None:
        messages.append(message)
    return messages


def test_the_options_name_the_wire() -> None:
    assert Wire.of(can=False, classic=False) is Wire.TCP
    assert Wire.of(can=True, classic=False) is Wire.CAN_FD
    assert Wire.of(can=True, classic=True) is Wire.of(can=False, classic=True) is Wire.CAN_CLASSIC


def test_a_realm_whose_name_is_a_number_has_a_bus_too() -> None:
    for address in (Wire.CAN_FD.address("7", number) for number in (1, 2)):
        assert first_port(read(parse(address)).channel) > 1024


async def test_classic_can_carries_both_robots_and_pictures(tmp_path: Path, listeners: Any) -> None:
    async with playing(Wire.CAN_CLASSIC, tmp_path) as realm_client:
        bus = listeners(channel(Wire.CAN_CLASSIC))
        at = await realm_client.call("arm-1", "get_info", {})
        goal = {"x": at["x"], "y": at["y"], "z": at["z"] - 0.03, "twist": at["twist"]}
        await realm_client.call("arm-1", "go_to", goal)
        assert (await realm_client.call("arm-1", "get_info", {}))["z"] == pytest.approx(goal["z"], abs=0.005)
        await realm_client.call("rover-1", "move", {"x": 0.1, "y": 0.0})
        assert (await realm_client.call("rover-1", "get_info", {}))["x"] == pytest.approx(0.1, abs=0.01)
        picture = await realm_client.look("cell", width=320, height=180, quality=75)
        assert (picture.width, picture.height) == (320, 180)
        frames = heard(bus)
        assert len(frames) > 1000, "the picture alone takes a thousand"
        assert not any(frame.is_fd or frame.dlc > 8 for frame in frames)


async def test_loggers_of_others_and_our_own_hear_the_bus(tmp_path: Path) -> None:
    log, tape = tmp_path / "bus.log", tmp_path / "arm.tlog"
    async with playing(Wire.CAN_FD, tmp_path):
        logger = subprocess.Popen(  # noqa: ASYNC220  the bus is other processes' matter
            [
                sys.executable,
                "-m",
                "can.logger",
                "-i",
                "robotree",
                "-c",
                channel(Wire.CAN_FD),
                "--fd",
                "-f",
                str(log),
            ],
            stdout=subprocess.DEVNULL,
        )
        url = f"can:robotree/{channel(Wire.CAN_FD)}"
        recorded = robotree("wire", "record", "--connect", url, tape, "--for", "2s")
        assert recorded.returncode == exit_codes.DONE, recorded.stderr
        logger.terminate()
        logger.wait(60)
    for file in (log, tape):
        *_, last = robotree("wire", "decode", file, "--json").stdout.splitlines()
        statistics = json.loads(last)["statistics"]
        assert statistics["messages"]["ROBOTREE_TOOL"] > 50
        assert statistics["bad_crc"] == statistics["skipped"] == 0


@pytest.mark.soak
@pytest.mark.parametrize("options", [["--can"], ["--can", "--classic"]], ids=["fd", "classic"])
def test_the_whole_demo_plays_over_can(options: list[str], tmp_path: Path) -> None:
    played = robotree("demo", "--headless", *options, "--pictures", tmp_path / "pictures")
    assert played.returncode == exit_codes.DONE, played.stdout[-2000:] + played.stderr[-2000:]
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert verdict["ok"] is True
    assert verdict["lever_angle_rad"] > 0.75
    assert 0 < verdict["peak_force_n"] < 35
    assert len(verdict["pictures"]) == 2
