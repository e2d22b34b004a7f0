"""A host whose log was damaged or copied, or whose disk is full, says it in one sentence."""

from __future__ import annotations

import json
import resource
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew, Member
from robotree.vr.journal.segments import HEAD
from robotree.vr.network.realms import state_home
from tests.command_line import robotree

pytestmark = pytest.mark.e2e

REALM = "logs"
SQUARE = Path(__file__).parents[2] / "examples" / "move_square.py"
SLEEPER = """
from robotree.vr import VirtualRobot, command

class Sleeper(VirtualRobot):
    @command
    def rest(self) -> None:
        self.sleep(500)
"""
SMALLEST = 64
"""[bytes] that a file may have; signs of life are shorter."""


@pytest.fixture
async def crew(place: Path, tmp_path: Path) -> AsyncIterator[Crew]:
    """A realm with a lookup service."""
    del place
    async with Crew(REALM, tmp_path) as crew:
        await crew.start("lookup", "lookup-1")
        yield crew


async def host_with_a_robot(crew: Crew) -> Member:
    host = await crew.start("host", "h1")
    async with joined(REALM) as realm_client:
        await realm_client.create(str(SQUARE), "square", "h1")
    return host


async def killed(crew: Crew) -> Path:
    """Kill a host with a robot; returns its folder."""
    host = await host_with_a_robot(crew)
    host.kill()
    await host.process.wait()
    return state_home() / REALM / "hosts" / "h1"


def newest(folder: Path) -> Path:
    return max(folder.glob("*.log"))


def flip(folder: Path) -> None:
    data = bytearray(newest(folder).read_bytes())
    data[HEAD.size + 20] ^= 1
    newest(folder).write_bytes(data)


async def test_a_host_says_what_is_wrong_with_its_log_and_starts_nothing(crew: Crew) -> None:
    folder = await killed(crew)
    flip(folder)
    before = {path.name: path.lstat().st_size for path in folder.glob("*.log")}
    done = robotree("host", "h1", "--realm", REALM)
    assert done.returncode == exit_codes.REFUSED, done.stderr
    assert "Traceback" not in done.stderr
    *_, sentence = done.stderr.splitlines()
    assert "is damaged at byte 0 (its checksum is another one): none of its robots is started" in sentence
    assert "--forget" in sentence
    assert {path.name: path.lstat().st_size for path in folder.glob("*.log")} == before
    await crew.start("host", "h1", "--forget")


async def test_the_copy_of_a_hosts_folder_makes_no_second_host_of_its_robots(crew: Crew) -> None:
    folder = await killed(crew)
    shutil.copytree(folder, folder.with_name("h2"))
    done = robotree("host", "h2", "--realm", REALM)
    assert done.returncode == exit_codes.REFUSED
    assert "h2 is a copy of what host h1 keeps, and no robot can live twice: start host h1" in done.stderr
    await crew.start("host", "h1")
    async with joined(REALM) as realm_client:
        assert (await realm_client.describe("square")).host == "h1"


async def test_a_full_disk_is_told_while_the_robots_run_on(crew: Crew) -> None:
    host = await host_with_a_robot(crew)
    resource.prlimit(host.pid, resource.RLIMIT_FSIZE, (SMALLEST, resource.RLIM_INFINITY))
    async with joined(REALM) as realm_client:
        await realm_client.stop("square")
        (found,) = await realm_client.hosts()
        assert "its robots would not survive its end now" in found.trouble
        assert (await realm_client.describe("square")).host == "h1"
    (listed,) = json.loads(robotree("ls", "--hosts", "--json", "--realm", REALM).stdout)
    assert (listed["name"], listed["robots"], listed["trouble"]) == ("h1", ["square"], found.trouble)
    assert found.trouble in robotree("ls", "--hosts", "--realm", REALM).stdout
    doctor = robotree("doctor", "--realm", REALM)
    assert "host h1: its robots would not survive its end now" in " ".join(doctor.stdout.split())
    host.kill()
    await host.process.wait()
    following = await crew.start("host", "h1")
    assert "the robots of the last host are not back: the disk was full" in following.log


async def test_a_robot_whose_host_is_away_is_not_called_unknown(crew: Crew) -> None:
    folder = await killed(crew)
    before = newest(folder).read_bytes()
    done = robotree("stop", "square", "--realm", REALM)
    assert done.returncode == exit_codes.REFUSED
    assert done.stderr.startswith("robotree: square is away with its host h1, which wrote last ")
    assert done.stderr.endswith("s ago, so nothing was done; `robotree host h1` brings it back\n")
    unknown = robotree("cancel", "sqaure", "--realm", REALM)
    assert "no robot named 'sqaure' is running" in unknown.stderr
    assert newest(folder).read_bytes() == before
    await crew.start("host", "h1")
    assert robotree("show", "square", "--realm", REALM).returncode == exit_codes.DONE


async def test_what_goes_on_with_a_robot_whose_host_is_away_is_told(crew: Crew, tmp_path: Path) -> None:
    page = tmp_path / "sleeper.py"
    page.write_text(SLEEPER)
    host = await crew.start("host", "h1")
    async with joined(REALM) as realm_client:
        await realm_client.create(str(page), "sleeper", "h1")
        await realm_client.tell("sleeper", "rest", {}, deadline=600.0)
    host.kill()
    await host.process.wait()
    done = robotree("cancel", "sleeper", "--realm", REALM)
    assert "`robotree host h1` brings it back, and rest goes on then" in done.stderr
