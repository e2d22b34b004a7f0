"""A controller and a proxy on the two ends of a serial cable, whose adapters are pulled out and put back."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from robotree.protocol.messages import Tool
from robotree.proxy.connection import Connection
from robotree.proxy.session import ControllerSession
from robotree.sim.serving.server import serving
from robotree.vr.world.testing import until

pytestmark = pytest.mark.e2e


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
