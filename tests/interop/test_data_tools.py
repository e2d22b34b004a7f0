"""Foxglove's own SDK speaks the protocol that we speak, and what LeRobot stands on reads our data sets."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path

import pytest

from robotree.tui.cli import main
from tests.command_line import ran
from tests.interop.conftest import TOOLS
from tests.tui.recording.foxglove_client import connected
from tests.tui.recording.test_lerobot import written
from tests.waiting import until

pytestmark = pytest.mark.interop

HERE = Path(__file__).parent


async def test_the_client_of_our_tests_understands_a_server_of_the_sdk() -> None:
    server = await asyncio.create_subprocess_exec(
        str(TOOLS / "python"), str(HERE / "foxglove_sdk_server.py"), stdout=asyncio.subprocess.PIPE
    )
    assert server.stdout is not None
    port = int(await server.stdout.readline())
    try:
        async with connected(f"ws://127.0.0.1:{port}") as client:
            await until(lambda: "/count" in client.channels and "/echo" in client.services)
            await client.subscribe("/count", 7)
            await until(lambda: bool(client.heard.get(7)))
            await client.call("/echo", 3, word="hey")
            await until(lambda: 3 in client.answers)
            assert client.answers[3] == {"heard": {"word": "hey"}}
    finally:
        server.kill()
        await server.wait()


def test_a_data_set_is_read_as_lerobot_reads_it(tmp_path: Path) -> None:
    assert main(["export", "lerobot", str(written(tmp_path / "a.mcap")), str(tmp_path / "set")]) == 0
    read = ran(
        [str(TOOLS / "python"), str(HERE / "lerobot_set_reader.py"), str(tmp_path / "set")],
        env={**os.environ, "HF_HOME": str(tmp_path / "home"), "HF_HUB_OFFLINE": "1"},
    )
    assert read.returncode == 0, read.stderr
    found = json.loads(read.stdout.splitlines()[-1])
    assert found["task"] == "arm-1.lift z=0"
    assert (found["frames"], found["episodes"], found["picture"]) == (30, 2, [32, 16])
    assert found["state"] == pytest.approx([0.5, 1.0])
