"""A realm as a file, with real processes: applied, saved, damaged and applied again."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.programs import end_process, programs
from robotree.tui.realm_file.present import controllers
from tests.command_line import within_realm
from tests.terminal import ENTER, Person

pytestmark = pytest.mark.e2e

REALM = "whole"
EXAMPLES = Path(__file__).parents[2] / "examples"
TEAM = '''
"""Rovers that go together."""
from typing import Annotated
from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command

class Team(VirtualRobot):
    """Rovers that go together, and an arm that waits."""

    mover = Child("MoveTo", "waits", optional=True)
    rovers = Children("Rover", "go")
    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.3)] = 0.1
    places: tuple[float, float] = (1.0, 2.0)

    @command
    def count(self) -> int:
        """Count."""
        return len(self.rovers)
'''
CELL = f"""
key: realm
controllers:
  table: {{kind: arm, listen: "tcp:127.0.0.1:0"}}
  floor: {{kind: rover, listen: "tcp:127.0.0.1:0"}}
  yard: {{kind: rover, listen: "tcp:127.0.0.1:0"}}
lookups: [lookup-1]
hosts: [host-1, host-2]
spaces:
  jobs: {{store: jobs.db}}
proxies:
  arm-1: {{kind: arm, controller: table}}
  rover-1: {{kind: rover, controller: floor}}
  rover-2: {{kind: rover, controller: yard}}
views:
  cell: {{controller: table, cameras: {{cell: 100}}}}
robots:
  team:
    page: team.py
    host: host-2
    settings: {{speed: 20 cm/s, places: [3, 4.5]}}
    slots:
      mover: mover
      rovers: [rover-1, rover-2]
  mover:
    page: {EXAMPLES / "move_to.py"}
    host: host-1
    slots: {{arm: arm-1}}
"""
NOTHING = "hosts: []\n"


class Place:
    """A realm, and a folder with its files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._run = within_realm(REALM)
        self.write("team.py", TEAM)
        self.write("nothing.yaml", NOTHING)

    def write(self, name: str, text: str) -> Path:
        path = self.folder / name
        path.write_text(text)
        return path

    async def line(self, *words: str) -> tuple[int, str, str]:
        return await self._run(*words)

    async def apply(self, name: str, *options: str) -> tuple[int, Any, str]:
        """Apply a file; the result as plain data, and what was complained."""
        code, out, complaints = await self.line("apply", str(self.folder / name), "--json", *options)
        return code, json.loads(out), complaints

    async def tree(self) -> Any:
        """The robots as trees, without what is another thing each time."""
        code, out, _ = await self.line("tree", "--json")
        assert code == exit_codes.DONE
        return json.loads(out)

    async def shape(self) -> dict[str, Any]:
        """Kind, home, settings and children of each robot."""
        async with joined(REALM) as realm_client:
            return {
                robot.name: (
                    robot.kinds,
                    robot.host,
                    robot.page,
                    [(slot.name, slot.child.name) for slot in robot.slots if slot.child],
                    [
                        (field.name, field.default)
                        for spec in robot.commands
                        for field in spec.parameters
                        if spec.name == "set"
                    ],
                )
                for robot in await realm_client.tree()
            }

    def processes(self) -> set[int]:
        return {program.pid for program in programs(REALM).values()} | {
            controller.pid for controller in controllers(REALM).values()
        }

    def process_of(self, name: str) -> int:
        return next(one.pid for address, one in programs(REALM).items() if address.name == name)

    async def close(self) -> None:
        """End all that was started, whatever became of it."""
        for pid in self.processes():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
async def cell(place: Path) -> AsyncIterator[Place]:
    folder = place.with_name("files")
    folder.mkdir()
    found = Place(folder)
    found.write("cell.yaml", CELL)
    try:
        yield found
    finally:
        await found.close()


async def test_a_file_becomes_a_realm_and_the_realm_becomes_the_same_file_again(cell: Place) -> None:
    code, _, _ = await cell.line("apply", str(cell.folder / "cell.yaml"), "--dry-run")
    assert code == exit_codes.DONE
    assert not cell.processes(), "a dry run starts nothing"

    code, done, complaints = await cell.apply("cell.yaml")
    assert code == exit_codes.DONE, complaints
    assert {step["outcome"] for step in done["steps"]} == {"done"}
    there, running = await cell.shape(), cell.processes()
    assert len(running) == 11
    assert there["team"][3] == [("mover", "mover"), ("rovers[0]", "rover-1"), ("rovers[1]", "rover-2")]
    assert ("speed", 0.2) in there["team"][4]
    assert ("places", [3.0, 4.5]) in there["team"][4]

    code, done, _ = await cell.apply("cell.yaml")
    assert (code, done["steps"], done["left"], done["against"]) == (exit_codes.DONE, [], [], [])
    assert cell.processes() == running

    code, _, complaints = await cell.line("save", str(cell.folder / "saved.yaml"))
    assert (code, complaints) == (exit_codes.DONE, "")
    code, done, _ = await cell.apply("saved.yaml")
    assert (code, done["steps"]) == (exit_codes.DONE, []), "what was saved is what runs"

    code, done, complaints = await cell.apply("nothing.yaml", "--prune", "--yes")
    assert code == exit_codes.DONE, complaints
    assert not cell.processes()
    code, done, complaints = await cell.apply("saved.yaml")
    assert code == exit_codes.DONE, complaints
    assert await cell.shape() == there
    again = cell.folder / "again.yaml"
    await cell.line("save", str(again))
    kept = again.read_text()
    code, _, complaints = await cell.line("save", str(again))
    assert code == exit_codes.USAGE
    assert f"{again} is there already; give another name, or --force to replace it" in complaints
    assert again.read_text() == kept
    assert (await cell.line("save", str(again), "--force"))[0] == exit_codes.DONE
    assert again.read_text().partition("\n")[2] == (cell.folder / "saved.yaml").read_text().partition("\n")[2]


SMALL = f"""
hosts: [host-1, host-2]
robots:
  low: {{page: low.py, host: host-1}}
  mover: {{page: {EXAMPLES / "move_to.py"}, host: host-1}}
  team: {{page: team.py, host: host-2, slots: {{mover: mover}}}}
"""


@pytest.fixture
async def small(cell: Place) -> Place:
    """Virtual robots alone, of which one commands another."""
    cell.write("low.py", TEAM)
    cell.write("small.yaml", SMALL)
    code, _, complaints = await cell.apply("small.yaml")
    assert code == exit_codes.DONE, complaints
    return cell


async def test_a_host_that_died_is_started_again_from_the_row_of_its_robot(small: Place) -> None:
    person = Person(REALM, columns=140, lines=40)
    try:
        await asyncio.to_thread(person.shows, b"team")
        await killed(small.process_of("host-1"))
        await asyncio.to_thread(person.shows, b"GONE")
        await asyncio.to_thread(person.types, "/GONE" + ENTER, sees="2 of")
        await asyncio.to_thread(person.types, "X", sees="host-1 was started again")
        await asyncio.to_thread(person.types, "g", sees="host-1 is started again, as `apply` started it")
        code, _, complaints = await small.line("restart", "host-1")
        assert code == exit_codes.REFUSED
        assert "host-1 is not started again: it runs" in complaints
        code, _, complaints = await small.line("restart", "stranger")
        assert "it is no service of systemd here, and `apply` has not started it" in complaints
    finally:
        person.leave()


ARM = """
controllers:
  table: {kind: arm, listen: "tcp:127.0.0.1:0"}
hosts: [host-1]
proxies:
  arm-1: {kind: arm, controller: table}
robots:
  mover: {page: mover.py, host: host-1, slots: {arm: arm-1}}
"""
MOVER = """
import os, time
from robotree.vr import Child, VirtualRobot, command

class Mover(VirtualRobot):
    arm = Child("Arm")

    @command
    def wave(self, rounds: int) -> int:
        if os.fork() == 0:
            time.sleep(20)
            os._exit(0)
        for n in range(rounds):
            self.arm.go_to(x=0.4, y=0.04 * (n % 2), z=0.4, twist=0.0, speed=0.05)
        return rounds
"""


async def killed(pid: int) -> None:
    """Kill a process that is no child of ours, and wait until it has ended."""
    handle, over = os.pidfd_open(pid), asyncio.Event()
    asyncio.get_running_loop().add_reader(handle, over.set)
    os.kill(pid, signal.SIGKILL)
    await over.wait()
    asyncio.get_running_loop().remove_reader(handle)
    os.close(handle)


async def test_a_command_of_a_proxied_arm_goes_on_after_its_host_was_killed(cell: Place) -> None:
    """The file is applied after a kill; what the page has forked lives on."""
    cell.write("mover.py", MOVER)
    cell.write("arm.yaml", ARM)
    code, _, complaints = await cell.apply("arm.yaml")
    assert code == exit_codes.DONE, complaints
    saved = cell.folder / "saved.yaml"
    await cell.line("save", str(saved))
    words = ("call", "mover.wave", "rounds=2", "--within", "240 s", "--json")
    call = asyncio.ensure_future(cell.line(*words))
    async with joined(REALM) as realm_client:
        while (await realm_client.describe("arm-1")).busy != "go_to":
            assert not call.done(), call.result()
            await asyncio.sleep(0.02)
        await killed(cell.process_of("host-1"))
        code, done, complaints = await cell.apply("saved.yaml")
        assert code == exit_codes.DONE, complaints
        assert {step["sign"] for step in done["steps"]} == {"+"}, "the arm waits: nobody releases it"
        assert {step["reason"] for step in done["steps"][1:]} == {"host-1 has brought it back"}
    code, answer, complaints = await call
    assert code == exit_codes.DONE, complaints
    assert json.loads(answer) == 2


async def test_what_is_not_in_the_file_ends_only_when_it_is_said_twice(small: Place) -> None:
    async with joined(REALM) as realm_client:
        await realm_client.create(str(small.folder / "team.py"), "stranger", host="host-2")
        await realm_client.release("team", "mover")
        await realm_client.enslave("stranger", "mover", "mover")
    code, done, complaints = await small.apply("small.yaml")
    assert code == exit_codes.REFUSED
    assert done["steps"] == []
    assert "mover stays in stranger.mover, for stranger is not in the file" in complaints

    code, answer, _ = await small.apply("small.yaml", "--prune")
    assert code == exit_codes.USAGE
    assert "--yes" in answer["message"]
    assert (await small.shape())["stranger"]

    code, done, complaints = await small.apply("small.yaml", "--prune", "--yes")
    assert code == exit_codes.DONE, complaints
    assert [step["line"] for step in done["steps"]] == ["delete stranger", "enslave team.mover mover"]
    assert "stranger" not in await small.shape()


async def test_a_person_is_asked_before_anything_ends(small: Place) -> None:
    async with joined(REALM) as realm_client:
        await realm_client.create(str(small.folder / "team.py"), "stranger", host="host-2")

    def answered(keys: str, said: str) -> None:
        person = Person(REALM, "apply", str(small.folder / "small.yaml"), "--prune")
        person.shows(b"Type yes to go on")
        person.types(keys, sees=said)
        person.wait()
        person.close()

    await asyncio.to_thread(answered, f"no{ENTER}", "nothing was ended")
    assert "stranger" in await small.shape()
    await asyncio.to_thread(answered, f"yes{ENTER}", "1 of 1 steps are done")
    assert "stranger" not in await small.shape()


async def test_what_a_host_brings_back_is_asked_about_too(small: Place) -> None:
    async with joined(REALM) as realm_client:
        await realm_client.create(str(small.folder / "team.py"), "stranger", host="host-1")
    await end_process(small.process_of("host-1"))
    code, answer, _ = await small.apply("small.yaml", "--prune")
    assert code == exit_codes.USAGE, (
        "the first plan ended nothing; the host brought back what is not in the file"
    )
    assert "nothing was ended" in answer["message"]
    assert "stranger" in await small.shape()
    await end_process(small.process_of("host-1"))
    code, done, complaints = await small.apply("small.yaml", "--prune", "--yes")
    assert code == exit_codes.DONE, complaints
    assert done["steps"][-1]["line"] == "delete stranger"
    assert set(await small.shape()) == {"low", "mover", "team"}


async def test_a_robot_in_a_host_of_its_own_has_one_again(small: Place) -> None:
    code, _, complaints = await small.line(
        "create", str(small.folder / "team.py"), "as", "solo", "--own-host"
    )
    assert code == exit_codes.DONE, complaints
    there = await small.shape()
    await small.line("save", str(small.folder / "saved.yaml"))
    assert "  solo-host: {only: solo}" in (small.folder / "saved.yaml").read_text()
    code, _, complaints = await small.apply("nothing.yaml", "--prune", "--yes")
    assert code == exit_codes.DONE, complaints
    assert not small.processes()
    code, _, complaints = await small.apply("saved.yaml")
    assert code == exit_codes.DONE, complaints
    assert await small.shape() == there


async def test_a_step_that_fails_keeps_back_what_needs_it_and_nothing_else(cell: Place) -> None:
    cell.write("broken.py", TEAM + "\nraise RuntimeError('on purpose')\n")
    cell.write(
        "some.yaml",
        f"""
hosts: [host-1]
robots:
  below: {{page: {EXAMPLES / "move_to.py"}}}
  broken: {{page: broken.py, slots: {{mover: below}}}}
  sound: {{page: team.py}}
""",
    )
    code, done, complaints = await cell.apply("some.yaml")
    assert code == exit_codes.REFUSED
    outcomes = {step["line"].rpartition("/")[2]: step for step in done["steps"]}
    assert outcomes["broken.py as broken"]["outcome"] == "failed"
    assert "on purpose" in outcomes["broken.py as broken"]["reason"]
    assert outcomes["enslave broken.mover below"]["outcome"] == "kept back"
    assert "as broken" in outcomes["enslave broken.mover below"]["reason"]
    assert outcomes["team.py as sound"]["outcome"] == "done"
    assert set(await cell.shape()) == {"below", "sound"}
    assert "Traceback" not in complaints


async def test_a_changed_setting_page_or_bond_is_changed_where_it_runs(small: Place) -> None:
    async with joined(REALM) as realm_client:
        kept = (await realm_client.describe("team")).address
    small.write("team.py", TEAM.replace("Rovers that go together", "Rovers that go alone"))
    small.write(
        "small.yaml",
        SMALL.replace("slots: {mover: mover}", "slots: {mover: []}, settings: {speed: 5 cm/s}").replace(
            "low.py, host: host-1", "low.py, host: host-1, slots: {mover: mover}"
        ),
    )
    code, done, complaints = await small.apply("small.yaml")
    assert code == exit_codes.DONE, complaints
    lines = [step["line"] for step in done["steps"]]
    assert lines == [
        f"reload team {small.folder / 'team.py'}",
        "set team 'speed=5 cm/s'",
        "release team.mover",
        "enslave low.mover mover",
    ]
    async with joined(REALM) as realm_client:
        team = await realm_client.describe("team")
    assert team.address == kept
    assert team.doc.startswith("Rovers that go alone")
    assert ("mover", "mover") in (await small.shape())["low"][3]
    code, done, _ = await small.apply("small.yaml")
    assert (code, done["steps"]) == (exit_codes.DONE, [])


async def test_nobody_is_saved_from_an_empty_realm(cell: Place) -> None:
    code, _, complaints = await cell.line("save", str(cell.folder / "saved.yaml"))
    assert code == exit_codes.NOBODY
    assert "nobody is in realm" in complaints
    assert not (cell.folder / "saved.yaml").exists()
