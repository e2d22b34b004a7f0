"""Robots over a CAN bus, on which anybody can listen, and over a serial cable that is pulled out."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import can
import pytest

from robotree.client.joining import joined
from robotree.protocol.canbus.membership import first_port
from robotree.protocol.links.can.address import read
from robotree.protocol.links.url import parse
from robotree.protocol.messages import Tool
from robotree.proxy.connection import Connection
from robotree.proxy.session import ControllerSession
from robotree.sim.serving.server import serving
from robotree.tui import exit_codes
from robotree.tui.demo import Wire, cast
from robotree.tui.processes.crew import Crew
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.command_line import robotree

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300), pytest.mark.usefixtures("place")]

REALM = f"can-{os.getpid()}"
CHANNEL = f"demo-{REALM}"
"""Of the bus, which is one of this process alone."""


@asynccontextmanager
async def playing(folder: Path) -> AsyncGenerator[RealmClient]:
    """The demo's own cast, over classic CAN."""
    async with Crew(REALM, folder) as crew:
        await cast(crew, wire=Wire.CAN_CLASSIC)
        async with joined(REALM) as realm_client:
            await until(
                lambda: len(realm_client.robots()) == 2 and len(realm_client.views()) == 1,
                "the cast is listed",
            )
            async with asyncio.timeout(60):
                for robot in ("arm-1", "rover-1"):
                    while not (await realm_client.describe(robot)).online:  # noqa: ASYNC110  an answer has no event
                        await asyncio.sleep(0.02)
            yield realm_client


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


async def test_classic_can_carries_both_robots_and_pictures(tmp_path: Path) -> None:
    async with playing(tmp_path) as realm_client:
        bus = can.Bus(interface="robotree", channel=CHANNEL)  # a member that only listens, as candump does
        at = await realm_client.call("arm-1", "get_info", {})
        goal = {"x": at["x"], "y": at["y"], "z": at["z"] - 0.03, "twist": at["twist"]}
        await realm_client.call("arm-1", "go_to", goal)
        assert (await realm_client.call("arm-1", "get_info", {}))["z"] == pytest.approx(goal["z"], abs=0.005)
        await realm_client.call("rover-1", "move", {"x": 0.1, "y": 0.0})
        assert (await realm_client.call("rover-1", "get_info", {}))["x"] == pytest.approx(0.1, abs=0.01)
        picture = await realm_client.look("cell", width=320, height=180, quality=75)
        assert (picture.width, picture.height) == (320, 180)
        frames = heard(bus)
        bus.shutdown()
        assert len(frames) > 1000, "the picture alone takes a thousand"
        assert not any(frame.is_fd or frame.dlc > 8 for frame in frames)


async def test_loggers_of_others_and_our_own_hear_the_bus(tmp_path: Path) -> None:
    log, tape = tmp_path / "bus.log", tmp_path / "rover.tlog"
    async with Crew(REALM, tmp_path) as crew:
        await crew.start("sim", "rover", "--listen", Wire.CAN_FD.address(REALM, 1))
        logger = subprocess.Popen(  # noqa: ASYNC220  the bus is other processes' matter
            [
                *(sys.executable, "-m", "can.logger", "-i", "robotree"),
                *("-c", CHANNEL, "--fd", "-f", str(log)),
            ],
            stdout=subprocess.DEVNULL,
        )
        url = f"can:robotree/{CHANNEL}"
        recorded = robotree("wire", "record", "--connect", url, tape, "--for", "2s")
        assert recorded.returncode == exit_codes.DONE, recorded.stderr
        logger.terminate()
        logger.wait(60)
    assert "##" in log.read_text(), "frames of CAN FD, as candump writes them"
    for file in (log, tape):
        *_, last = robotree("wire", "decode", file, "--json").stdout.splitlines()
        statistics = json.loads(last)["statistics"]
        assert statistics["messages"]["LOCAL_POSITION_NED"] > 50
        assert statistics["bad_crc"] == statistics["skipped"] == 0


async def test_a_robot_behind_a_serial_line_is_found_again_when_its_adapter_is_back(
    make_cable: Callable[[], Any],
) -> None:
    cable = make_cable()
    url = cable.url(0, "?baud=115200")
    async with serving("arm", cable.url(1, "?baud=115200")) as server:
        assert server.address == cable.url(1, "?baud=115200")
        session = ControllerSession()
        connection = Connection(url, session, on_event=lambda _: None)
        running = asyncio.create_task(connection.run())
        try:
            await until(lambda: session.online and session.twin.latest(Tool), "the arm is found and told of")
            cable.pull()
            await until(lambda: not session.online, "its end is noticed")
            assert session.trouble == f"the link to its controller is broken: {url} broke: it was unplugged"
            await until(lambda: "there is no such device; plug it in" in session.trouble, "and why")
            cable = make_cable()
            await until(lambda: session.online, "it is found again")
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
