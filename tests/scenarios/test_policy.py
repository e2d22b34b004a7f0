"""A policy on one machine, from its file to the refusal: the verbs, with real processes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.tui.exit_codes import NOBODY, REFUSED
from robotree.tui.processes.crew import Crew
from robotree.vr.base.principal import user_name
from tests.command_line import within_realm
from tests.plant import Machine
from tests.waiting import wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400)]  # it says many lines

ME = user_name(os.geteuid())

PAGE = """
from robotree.vr import VirtualRobot, command

class Lamp(VirtualRobot):
    @command
    def on(self) -> None: ...
    @command
    def off(self) -> None: ...
"""


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    machine = Machine(tmp_path, "m")
    yield machine
    for called in list(machine.running):
        machine.end(called)


def written(folder: Path, version: int, *lines: str) -> str:
    path = folder / "plant.yaml"
    head = f"realm: plant\nversion: {version}\npersons: {{'{ME}': some}}\nroles:\n  some:\n"
    path.write_text(head + "".join(f"    {line}\n" for line in ("administrate: yes", *lines)))
    return str(path)


def test_a_policy_is_set_kept_explained_and_never_goes_back(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "lamp.py").write_text(PAGE)
    machine.start("lookup", "lookup", "lookup-1")
    machine.start("host", "host", "host-1")
    machine.say("create", str(tmp_path / "lamp.py"), "as", "lamp")
    assert machine.say("policy", "show")["version"] == 0
    first = written(tmp_path, 1, "see: '*'", "command: lamp.on")
    assert {row["right"] for row in machine.say("policy", "check", first)["lines"]} == {
        "administrate", "see", "command",
    }  # fmt: skip
    machine.say("policy", "set", first)
    machine.say("call", "lamp.on")
    wait_until(lambda: _refused(machine, "call", "lamp.off"), "the policy is in force")
    said = machine.say("call", "lamp.off", code=REFUSED)
    assert said["error"] == "Denied"
    assert "line 8 allows command only of lamp.on; ask " in str(said)
    told = machine.say("may", ME, "call", "lamp.off")
    assert (told["allowed"], told["line"], told["ask"]) == (False, 8, ME)
    machine.say("stop", "lamp")
    assert "without any line for resume" in str(machine.say("resume", "lamp", code=NOBODY))
    # nobody sets an older one, or one with which nobody could set another
    assert "is not higher than 1" in str(machine.say("policy", "set", first, code=REFUSED))
    (tmp_path / "locked.yaml").write_text("realm: plant\nversion: 2\n")
    locked = machine.say("policy", "set", str(tmp_path / "locked.yaml"), code=REFUSED)
    assert "give yourself administrate" in str(locked)
    # what is hidden is in no list
    machine.say("policy", "set", written(tmp_path, 2, "see: other"))
    wait_until(lambda: _refused(machine, "show", "lamp"), "it cannot be seen any more")
    assert machine.say("ls") == []


async def test_a_crew_that_keeps_its_things_elsewhere_obeys_the_same_policy(place: Path) -> None:
    run = within_realm("plant")
    (place / "lamp.py").write_text(PAGE)
    async with Crew("plant", place, state=place / "elsewhere") as crew:
        await crew.start("lookup", "lookup-1")
        await crew.start("host", "host-1")
        assert (await run("create", str(place / "lamp.py"), "as", "lamp"))[0] == 0
        assert (await run("policy", "set", written(place, 1, "see: '*'", "command: lamp.on")))[0] == 0
        assert (await run("call", "lamp.on"))[0] == 0
        code, complaints = 0, ""
        while code == 0:  # in force within a second, in each process
            code, _, complaints = await run("call", "lamp.off")
        assert "allows command only of lamp.on" in complaints


def _refused(machine: Machine, *words: str) -> bool:
    try:
        machine.say(*words, code=REFUSED)
    except AssertionError:
        return False
    return True
