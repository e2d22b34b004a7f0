"""Every verb against the demo's real processes: what it prints as plain data, and how it ends."""

from __future__ import annotations

import asyncio
import json
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.line import manual
from robotree.tui.line.action import Where
from robotree.tui.line.actions import ACTIONS
from tests.command_line import ROBOTREE

pytestmark = pytest.mark.e2e

EXAMPLES = Path(__file__).parents[2] / "examples"
CAST = """
import asyncio, sys
from pathlib import Path
from robotree.tui.demo import cast
from robotree.tui.processes.crew import Crew

async def be() -> None:
    async with Crew("default", Path(sys.argv[1])) as crew:
        await cast(crew)
        print("ready", flush=True)
        await asyncio.to_thread(sys.stdin.read)

asyncio.run(be())
"""


@pytest.fixture(scope="module")
def folder(shared_place: Path) -> Iterator[Path]:
    """The demo's cast in a realm of this module alone; the folder takes what verbs write."""
    words = [sys.executable, "-c", CAST, str(shared_place)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as crew:
        assert crew.stdout
        assert crew.stdout.readline() == "ready\n"
        yield shared_place


Say = Callable[..., Any]


@pytest.fixture
def say(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Say:
    """Say a line with `--json` and return what it printed, read again."""
    monkeypatch.chdir(folder)

    def obey(*words: str, code: int = exit_codes.DONE) -> Any:
        capsys.readouterr()
        assert main([*words, "--json"]) == code, capsys.readouterr().err
        return [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return obey


ARM = {"address", "kinds", "doc", "attributes", "commands", "calls"}
"""The description of an arm; usual values (nothing runs, it has no commander) are left out."""
STATE = {"name", "readings"}

SHAPES: list[tuple[str, type, set[str]]] = [
    ("ls", list, {"address", "kinds", "doc", "commands", "attributes", "revision"}),
    ("ls --views", list, {"address", "kinds", "attributes", "revision"}),
    ("ls --hosts", list, {"name", "robots", "stands_by", "instead_of", "trouble"}),
    ("ls --lookups", list, {"name"}),
    ("tree", list, {"name", "kind", "state", "children"}),
    ("show arm-1", dict, ARM - {"calls"}),
    ("stubs arm-1", dict, {"kind", "source"}),
    ("look cell --size 64x36", dict, {"file", "camera", "width", "height"}),
    ("create {examples}/move_to.py as mover", dict, {"address", "kinds", "doc", "host", "commands", "slots"}),
    ("enslave mover.arm arm-1", dict, {"address", "kinds", "slots"}),
    ("call mover.get_info", dict, {"x", "y", "z", "twist"}),
    ("reload mover", dict, {"reloaded", "page", "notes"}),
    ("create {folder}/paced.py as paced speed=0.2", dict, {"address", "kinds", "host"}),
    ("set paced speed=0.3", dict, {"name", "settings"}),
    ("call paced.greet", dict, {"words"}),
    ("log paced", list, {"number", "level", "text"}),
    ("pause mover", dict, {"paused", "note"}),
    ("call mover.move x=0.3 y=0 z=0.3 twist=0 --detach", dict, {"detached"}),
    ("step mover", dict, {"step", "stands"}),
    ("where mover", dict, {"line", "runs", "page", "steps", "times"}),
    ("alarm above arm-1.x 20", dict, {"robot", "reading", "sign", "limit"}),
    ("alarm below arm-1.y -20", dict, {"robot", "reading", "sign", "limit"}),
    ("alarms", list, {"robot", "reading", "state"}),
    ("alarm ack", dict, {"acknowledged"}),
    ("alarm clear arm-1.x", dict, {"cleared"}),
    ("alarm clear arm-1.y", dict, {"cleared"}),
    ("continue mover", dict, {"continued", "note"}),
    ("cancel mover", dict, {"cancelled"}),
    ("stop rover-1", dict, {"stopped"}),
    ("resume rover-1", dict, {"resumed"}),
    ("release mover.arm", dict, {"address", "kinds", "slots"}),
    ("delete mover", dict, {"deleted"}),
    ("may root command rover-1", dict, {"allowed", "reason", "version"}),
    ("orders", dict, {"orders", "holds", "silent"}),
    ("group pair rover-1 arm-1", dict, {"name", "names", "where"}),
    ("groups", list, {"name", "names", "where"}),
    ("places add shelf of arm-1", dict, {"name", "frame", "at", "by"}),
    ("places arm-1", list, {"name", "frame", "at", "by"}),
    ("call arm-1.preview_go_to @shelf z=0.3", dict, {"x", "y", "z", "duration", "checked"}),
    ("go arm-1 @shelf z=0.3 --preview", dict, {"robot", "command", "goal", "way", "done"}),
    ("places remove @shelf", dict, {"removed"}),
    ("group pair --delete", dict, {"deleted"}),
    ("run {folder}/a.session", dict, {"ok", "script", "wall_s", "steps", "not_played"}),
]
"""Verb, what its data is, and what is in it (in each part of a list): as `docs/operating.md` says."""


PACED = """
from dataclasses import dataclass
from typing import Annotated

from robotree.vr import Range, VirtualRobot, command

@dataclass
class Greeting:
    words: str

class Paced(VirtualRobot):
    speed: Annotated[float, Range(0, 1)] = 0.1

    @command
    def greet(self) -> Greeting:
        print("hello")
        return Greeting("done")
"""


@pytest.mark.parametrize(("line", "kind", "keys"), SHAPES, ids=[line for line, _, _ in SHAPES])
def test_plain_data_of_each_verb_has_its_documented_shape(
    line: str, kind: type, keys: set[str], say: Say, folder: Path
) -> None:
    (folder / "a.session").write_text("expect arm-1 listed\nexpect done\n")
    (folder / "paced.py").write_text(PACED)
    (data,) = say(*line.format(examples=EXAMPLES, folder=folder).split())
    assert isinstance(data, kind)
    for part in data if isinstance(data, list) else [data]:
        assert keys <= part.keys()
    assert data, "an empty answer would prove nothing"


def test_watching_prints_an_object_for_each_state(say: Say) -> None:
    states = say("watch", "arm-1", "--within", "1500ms")
    assert states
    assert all(state.keys() >= STATE and state["name"] == "arm-1" for state in states)


def test_no_verb_over_a_realm_is_left_out() -> None:
    spoken = {action.verb for action in ACTIONS}
    proved = {"watch", "places remove"}
    proved |= {
        verb
        for line, _, _ in SHAPES
        for verb in (line.split()[0], " ".join(line.split()[:2]))
        if verb in spoken
    }
    proved |= {"role", "rules explain"}  # over scripts and companions: their own tests show them
    proved |= {"decide", "space ls", "history", "why"}  # of hosts that crashed, of spaces, of what was kept
    proved |= {"inbox", "order show", "order cancel", "order confirm", "take"} | {
        "order settle"
    }  # of robots that are away
    proved |= {"migrate", "drain", "place", "service"}  # of several hosts, and of services
    proved |= {"permits", "permit allow", "permit deny"}  # of assistants: tests/assistants
    proved |= {"fault cut", "fault delay", "fault freeze", "fault kill"}  # tests/scenarios/test_trials.py
    proved |= {"questions"}  # of scripts: tests/tui/screens/test_questions.py
    proved |= {"alarms watch"}  # tests/tui/test_alarms_without_a_screen.py
    proved |= {"compose"}  # tests/tui/composing
    proved |= {"restart"}  # of what has gone: tests/tui/test_readiness.py
    proved |= {"foxglove"}  # tests/scenarios/test_trials.py
    proved |= {"who", "say"} | {
        f"control {how}" for how in ("get", "ask", "offer", "take", "leave")
    }  # operators
    proved |= {"record"}  # until it is interrupted: tests/scenarios/test_recordings.py
    promised = {action.verb for action in ACTIONS if action.run and Where.SHELL in action.where} | {"run"}
    assert proved == promised


@pytest.mark.usefixtures("folder")
def test_a_second_demo_in_a_realm_says_that_there_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--headless", "--realm", "default"]) == exit_codes.REFUSED
    said = capsys.readouterr().err
    assert "a demo already runs in realm 'default' (arm-1, cell, directory-1, host-1" in said
    assert said.count("robotree: ") == 1


@pytest.mark.usefixtures("folder")
def test_watching_ends_when_its_reader_leaves() -> None:
    with subprocess.Popen(
        [*ROBOTREE, "watch"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stderr
        assert process.stdout.readline()
        process.stdout.close()
        assert process.wait(60) == exit_codes.DONE
        assert process.stderr.read() == ""


@pytest.mark.usefixtures("folder")
def test_the_first_walk_of_the_help_works_as_it_is_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    typed = [line.strip() for line in manual.WALK.splitlines() if line.startswith("  robotree ")]
    assert typed[0].startswith("robotree demo")
    for line in typed[1:]:
        assert main(shlex.split(line)[1:]) == exit_codes.DONE, f"{line}: {capsys.readouterr().err}"
    assert "arm: arm-1" in capsys.readouterr().out
    assert main(["delete", "mover"]) == exit_codes.DONE


def test_every_reading_of_the_cell_has_a_unit(say: Say) -> None:
    async def instruments() -> tuple[dict[str, float], dict[str, str]]:
        async with joined("default") as realm_client:
            told = await realm_client.describe_view("cell")
            return told.readings, told.units

    (arm,), (rover,) = say("show", "arm-1"), say("show", "rover-1")
    readings, units = asyncio.run(instruments())
    assert {"j1", "x", "fx", "age"} <= arm["readings"].keys()
    assert {"lever", "peak_force"} <= readings.keys()
    for told, known in (
        (arm["readings"], arm["units"]),
        (rover["readings"], rover["units"]),
        (readings, units),
    ):
        assert told.keys() <= known.keys()
