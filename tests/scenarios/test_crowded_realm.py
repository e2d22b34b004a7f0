"""A host that has no descriptor free, or that is flooded with connections: stops and lists stay true."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm
from tests.waiting import until

pytestmark = pytest.mark.e2e

REALM = "crowded"
robotree = within_realm(REALM)
PAGE = '''
"""Hoarder: opens files and closes none."""
import os
import resource
from robotree.vr import VirtualRobot, command

class Hoarder(VirtualRobot):
    """Opens files and closes none."""

    @command
    def hoard(self) -> int:
        """Open all that can be opened, also what the program that asked for it has closed; then wait."""
        resource.setrlimit(resource.RLIMIT_NOFILE, (200, 200))
        opened = 0
        for _ in range(50):
            try:
                while True:
                    os.open("/dev/null", os.O_RDONLY)
                    opened += 1
            except OSError:
                self.sleep(0.1)
        self.progress(0.5, f"{opened} opened")
        self.sleep(60)
        return opened
'''
FLOOD = """
import socket, sys, time
from pathlib import Path
(path,) = Path(sys.argv[1]).glob(sys.argv[2] + "-*.sock")
end = time.monotonic() + 30
while time.monotonic() < end:
    lines = []
    for _ in range(50):
        line = socket.socket(socket.AF_UNIX)
        line.setblocking(False)
        try:
            line.connect(str(path))
            line.send(bytes(8))
        except OSError:
            pass
        lines.append(line)
    for line in lines:
        line.close()
"""
"""It ends by itself after 30 s."""


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    """A lookup service, and a host with a hoarder."""
    (place / "hoarder.py").write_text(PAGE)
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        code, _, complaints = await robotree("create", str(place / "hoarder.py"), "as", "hoarder")
        assert code == exit_codes.DONE, complaints
        yield crew


def pid_of_host(crew: Crew) -> int:
    return next(member.pid for member in crew.members if member.words[0] == "host")


async def test_a_host_without_a_free_descriptor_obeys_one_stop_after_another(crew: Crew) -> None:
    """The reserve is filled again each time."""
    async with joined(REALM) as realm_client:
        call = await robotree("call", "hoarder.hoard", "--detach")
        assert call[0] == exit_codes.DONE, call
        opened = Path(f"/proc/{pid_of_host(crew)}/fd")

        async def all_are_taken() -> bool:
            readings = (await realm_client.describe("hoarder")).readings
            return readings.get("progress") == 0.5 and len(os.listdir(opened)) >= 199  # noqa: PTH208 # of procfs

        await until(all_are_taken, "it has no descriptor free")
        for _ in range(3):
            code, out, complaints = await robotree("stop", "--json")
            assert code == exit_codes.DONE, complaints
            assert json.loads(out)["stopped"] == ["hoarder"]
        (hoarder,) = await realm_client.tree()
        assert hoarder.stopped


@contextmanager
def flood(place: Path, pid: int) -> Iterator[None]:
    folder = str(place / "robotree" / REALM)
    line = [sys.executable, "-S", "-c", FLOOD, folder, str(pid)]
    flooding = [subprocess.Popen(line) for _ in range(2)]
    try:
        yield
    finally:
        for one in flooding:
            one.kill()
            one.wait()


async def test_in_a_flood_of_connections_no_list_leaves_out_a_host_in_silence(
    crew: Crew, place: Path
) -> None:
    with flood(place, pid_of_host(crew)):
        for _ in range(3):
            code, out, complaints = await robotree("ls", "--hosts")
            assert "host-1" in out, "it runs"
            assert "hoarder" in out or code != exit_codes.DONE, "that it does not answer is said"
            assert "hoarder" in out or "host-1" in complaints
            code, out, complaints = await robotree("ls")
            assert "hoarder" in out or code != exit_codes.DONE, complaints
        code, out, complaints = await robotree("stop")
        assert code == exit_codes.DONE or "hoarder" in complaints, complaints
    async with joined(REALM) as realm_client:
        (hoarder,) = await realm_client.tree()
        assert hoarder.stopped, "the stop has come through the flood"
