"""A recording of the real simulated arm, and mavutil speaking our dialect."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from robotree.protocol.dialect import compile as compiler
from robotree.protocol.endpoint import Endpoint
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.sim.serving.server import serving

ENOUGH = 200
"""Frames; more than a second of the arm's telemetry."""


@pytest.fixture(scope="session")
def frames() -> list[Frame]:
    """What the simulated arm says in a good second."""
    heard: list[Frame] = []

    async def listen() -> None:
        enough = asyncio.Event()

        def hear(frame: Frame) -> None:
            heard.append(frame)
            if len(heard) >= ENOUGH:
                enough.set()

        def accept(link: Link) -> Endpoint:
            return Endpoint(link, system=255, component=190, on_frame=hear)

        async with serving("arm", "tcp:127.0.0.1:0") as server:
            link = await connect(server.address, accept)
            await asyncio.wait_for(enough.wait(), 60)
            link.close()
            await asyncio.sleep(0)

    asyncio.run(listen())
    assert len({frame.name for frame in heard}) >= 4
    return heard


@pytest.fixture(scope="session")
def mavutil(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The own reader and writer of pymavlink, with the module that mavgen makes of our dialect."""
    folder = tmp_path_factory.mktemp("dialect")
    compiler.generate(folder / "robotree_capture.py")
    os.environ["MAVLINK20"] = "1"
    import pymavlink.dialects.v20 as dialects

    dialects.__path__.append(str(folder))
    from pymavlink import mavutil as module

    module.set_dialect("robotree_capture")
    assert Path(sys.modules["pymavlink.dialects.v20.robotree_capture"].__file__ or "").parent == folder
    return module
