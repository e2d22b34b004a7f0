"""A host that is flooded with connections: stops and lists stay true."""

from __future__ import annotations

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

pytestmark = [pytest.mark.e2e, pytest.mark.soak]

REALM = "crowded"
robotree = within_realm(REALM)
PAGE = '''
from robotree.vr import VirtualRobot

class Quiet(VirtualRobot):
    """Does nothing."""
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
    """A lookup service, and a host with a robot."""
    (place / "quiet.py").write_text(PAGE)
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        code, _, complaints = await robotree("create", str(place / "quiet.py"), "as", "quiet")
        assert code == exit_codes.DONE, complaints
        yield crew


def pid_of_host(crew: Crew) -> int:
    return next(member.pid for member in crew.members if member.words[0] == "host")


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
            assert "quiet" in out or code != exit_codes.DONE, "that it does not answer is said"
            assert "quiet" in out or "host-1" in complaints
            code, out, complaints = await robotree("ls")
            assert "quiet" in out or code != exit_codes.DONE, complaints
        code, out, complaints = await robotree("stop")
        assert code == exit_codes.DONE or "quiet" in complaints, complaints
    async with joined(REALM) as realm_client:
        (quiet,) = await realm_client.tree()
        assert quiet.stopped, "the stop has come through the flood"
