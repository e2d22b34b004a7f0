"""Real hosts that are killed, whose log is damaged or whose disk is full: what people are told."""

from __future__ import annotations

import asyncio
import json
import os
import resource
import shutil
import signal
import sqlite3
from collections.abc import AsyncIterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew, Member
from robotree.tui.processes.state_files import history_files
from robotree.vr.journal.segments import HEAD
from robotree.vr.network.realms import state_home
from tests.command_line import robotree, within_realm
from tests.waiting import PATIENCE, until

pytestmark = pytest.mark.e2e

# -- what is told of a crash that a command has survived, and of a question that it asks ----------

WALKER = """
from robotree.vr import VirtualRobot, command, state


class Walker(VirtualRobot):
    taken: int = state(0)

    @command
    def walk(self, steps: int) -> int:
        "Walk."
        for _ in range(steps):
            self.sleep(0.1)
            self.taken += 1
        return self.taken

    @command(resume="ask")
    def careful(self) -> int:
        "Walk, and ask after a crash."
        return self.walk(steps=30)
"""


class Walks:
    """A host with a walker."""

    def __init__(self, crew: Crew, host: Member) -> None:
        self.run, self._crew, self._host = within_realm("told"), crew, host

    async def crashes_in(self, command: str) -> None:
        """Kill the host when the walker has taken its first steps, and start it again."""
        async with joined("told") as realm_client:

            async def walks() -> bool:
                found = await realm_client.describe("walker")
                return found.busy == command and found.kept["taken"] >= 2

            await until(walks, f"{command} is under way")
        self._host.kill()
        await self._host.process.wait()
        await self._crew.start("host", "h1")


@pytest.fixture
async def walker(place: Path) -> AsyncIterator[Walks]:
    (place / "walker.py").write_text(WALKER)
    async with Crew("told", place) as crew:
        await crew.start("lookup", "l1")
        walks = Walks(crew, await crew.start("host", "h1"))
        await walks.run("create", str(place / "walker.py"), "as", "walker")
        yield walks


async def test_history_and_log_tell_of_the_crash_and_of_no_second_beginning(walker: Walks) -> None:
    run = walker.run
    call = asyncio.ensure_future(run("call", "walker.walk", "steps=30", "--json"))
    await walker.crashes_in("walk")
    code, out, complaints = await call
    assert (code, json.loads(out)) == (0, 30), complaints

    code, log, _ = await run("log", "walker")
    assert code == 0
    assert log.count("is back after") == 1
    assert "walk goes on" in log
    assert log.count("walk begins") <= 1, log
    _, history, _ = await run("history", "walker")
    assert "host h1 ended at" in history
    assert "came back" in history
    for since in ("10min", "00:00", "2026-01-01T00:00", "2026-01-01"):
        assert (await run("history", "walker", "--since", since))[1], since
    code, _, complaints = await run("history", "walker", "--since", "noon")
    assert (code, "write for example 10min, 14:30" in complaints) == (exit_codes.USAGE, True), complaints
    _, why, _ = await run("why", "walker")
    assert "came back" in why
    assert "as they were written" in (await run("history", "walker", "--verify"))[1]


async def test_a_question_stands_in_the_list_until_it_is_answered(walker: Walks) -> None:
    run = walker.run
    call = asyncio.ensure_future(run("call", "walker.careful"))
    await walker.crashes_in("careful")
    listed = ""

    async def asks() -> bool:
        nonlocal listed
        await asyncio.sleep(0.3)  # each question is a process
        listed = "".join((await run("ls"))[1:])
        return "ASKS (decide walker)" in listed

    await until(asks, "the question is in the list")
    assert "walker.careful was interrupted" in listed
    assert (await run("decide", "walker", "again"))[0] == 0
    code, _, complaints = await call
    assert code == 0, complaints
    assert "decide walker" in complaints, complaints + " is what the caller sees"
    assert "ASKS" not in "".join((await run("ls"))[1:])


# -- who had a robot move is told across hosts ----------------------------------------------------

ARM = """
from robotree.vr import VirtualRobot, command


class Arm(VirtualRobot):
    @command
    def grip(self, force: float) -> float:
        "Grip."
        return force
"""
TEAM = """
from robotree.vr import Child, VirtualRobot, command


class Team(VirtualRobot):
    arm = Child("Arm")

    @command
    def fetch(self) -> None:
        "Fetch."
        self.arm.grip(force=1.5)
        self.arm.grip(force=2.5)
"""
LINE = TEAM.splitlines().index("        self.arm.grip(force=2.5)") + 1


async def test_the_last_motion_is_told_up_to_the_person_and_outlives_its_host(place: Path) -> None:
    run = within_realm("why")
    for name, page in (("arm", ARM), ("team", TEAM)):
        (place / f"{name}.py").write_text(page)

    async def lines(*words: str, code: int = 0) -> str:
        found, out, complaints = await run(*words)
        assert found == code, complaints
        return out + complaints

    async def why(name: str) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(await lines("why", name, "--json"))
        return answer

    async with Crew("why", place) as crew:
        await crew.start("lookup", "l1")
        below, above = await crew.start("host", "below"), await crew.start("host", "above")
        await lines("create", str(place / "arm.py"), "as", "arm", "on", "below")
        await lines("create", str(place / "team.py"), "as", "team", "on", "above")
        assert "nothing is kept of arm" in await lines("why", "arm", code=1)
        await lines("enslave", "team.arm", "arm")
        await lines("call", "team.fetch")

        told = await why("arm")
        arm, team = told["links"]
        assert told["person"] == team["call"]["person"] != ""
        assert (arm["source"], team["source"]) == ("host below", "host above")
        assert (arm["call"]["arguments"], arm["call"]["caller"], arm["step"]) == ({"force": 2.5}, "team", "2")
        assert (arm["call"]["line"], len(team["call"]["page"])) == (LINE, 64)
        assert arm["call"]["epoch"] > 0
        times = [team["call"]["unix"], arm["call"]["unix"], arm["ended"]["began"], arm["ended"]["unix"]]
        assert times == sorted(times)
        assert arm["ended"]["unix"] <= arm["answered"]["unix"] + 0.05
        assert await why(arm["call"]["key"]) == told, "a key is explained as its robot is"

        os.kill(below.pid, signal.SIGKILL)
        await below.process.wait()
        again = await crew.start("host", "below")
        await lines("call", "team.fetch")
        later = await why("arm")
        assert later["links"][0]["call"]["unix"] > arm["call"]["unix"]
        assert (await lines("history", "arm")).count("arm.grip force=2.5") == 2

        os.kill(again.pid, signal.SIGKILL)
        await again.process.wait()
        assert await why("arm") == later, "its file tells the same"
        assert "as they were written" in await lines("history", "arm", "--verify")
        async with asyncio.timeout(PATIENCE):
            while "child" in json.loads(await lines("show", "team", "--json"))["slots"][0]:  # noqa: ASYNC110
                await asyncio.sleep(0.5)  # each question is a process
        steps = json.loads(await lines("where", "team", "--json"))["steps"]
        assert [(one["robot"], one["value"]) for one in steps] == [("arm", 1.5), ("arm", 2.5)]

        with closing(sqlite3.connect(history_files("why")["host", "below"])) as file, file:
            file.execute("UPDATE event SET robot = 'somebody' WHERE number = 2")
        assert "host below: event 2 was changed" in await lines("history", "arm", "--verify", code=1)
        assert above.process.returncode is None


# -- a stop of everything concerns robots, too, whose host hangs and never wakes ------------------

SOLO = """
from pathlib import Path
from robotree.vr import VirtualRobot, command


class Solo(VirtualRobot):
    @command
    def go(self, steps: int) -> None:
        "Go."
        for step in range(steps):
            self.sleep(0.1)
            print(f"step {step}")
"""


async def test_robots_begin_stopped_whose_host_was_frozen_and_killed_later(place: Path) -> None:
    (place / "solo.py").write_text(SOLO)
    run = within_realm("away")

    async def steps() -> list[int]:
        return [(await run("log", robot))[1].count("step ") for robot in ("solo", "apart")]

    async def both_go() -> bool:
        return all(await steps())

    async with Crew("away", place) as crew:
        await crew.start("lookup", "l1")
        host = await crew.start("host", "h1")
        await run("create", str(place / "solo.py"), "as", "solo")
        await run("create", str(place / "solo.py"), "as", "apart", "--isolate", "process")
        for robot in ("solo", "apart"):
            going = await run("call", f"{robot}.go", "steps=600", "--detach", "--within", "90 s")
            assert going[0] == exit_codes.DONE
        await until(both_go, "both go")
        os.kill(host.pid, signal.SIGSTOP)
        code, _, complaints = await run("stop")
        for robot in ("solo", "apart"):
            assert f"{robot} will be stopped when host h1 is back" in complaints
        assert code == exit_codes.NOBODY, complaints
        os.kill(host.pid, signal.SIGKILL)
        await host.process.wait()
        again = await crew.start("host", "h1")

        async def listed_as_stopped() -> bool:
            return (await run("ls"))[1].count("STOPPED") == 2

        await until(listed_as_stopped, "both are stopped")
        done = await steps()
        await asyncio.sleep(1.0)
        assert await steps() == done, "they go on though everything was stopped"
        assert await listed_as_stopped()
        assert (await run("resume"))[0] == exit_codes.DONE
        for robot in ("solo", "apart"):
            assert (await run("call", f"{robot}.go", "steps=1"))[0] == exit_codes.DONE

        os.kill(again.pid, signal.SIGKILL)
        await again.process.wait()
        await crew.start("host", "h1")
        assert "STOPPED" not in (await run("ls"))[1], "the stop is over"


# -- a host whose log is damaged says it in one sentence ------------------------------------------

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
