"""The prompt and the shells complete what they know, and never change what was typed."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.cli import main
from robotree.tui.exit_codes import DONE, USAGE
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.completion import Words, candidates, complete
from robotree.tui.line.shells import SCRIPTS
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from tests.command_line import robotree
from tests.tui.conftest import Arm

WORDS = Words(
    {
        "NAME": ["arm-1", "mover"],
        "CHILD": ["arm-1"],
        "PARENT.SLOT": ["mover.arm"],
        "ROBOT.COMMAND": ["arm-1.go_to", "arm-1.grip"],
        "HOST": ["host-1"],
    }
)


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("ens", "enslave"),
        ("enslave mo", "enslave mover.arm"),
        ("enslave mover.arm a", "enslave mover.arm arm-1"),
        ("call arm-1.gr", "call arm-1.grip"),
        ("call a", "call arm-1.g"),
        ("sh", "show"),
        ("delete mo", "delete mover"),
        ("create a.py a", "create a.py as"),
        ("create a.py as b on h", "create a.py as b on host-1"),
        ("ls --vi", "ls --views"),
        ("look cell --cam", "look cell --camera"),
    ],
)
def test_the_next_word_is_suggested(typed: str, completed: str) -> None:
    assert complete(typed, WORDS) == completed


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("re", ("reload", "release", "resume", "restart", "readings")),
        ("call arm-1.g", ("arm-1.go_to", "arm-1.grip")),
        ("delete ", ("arm-1", "mover")),
        *((typed, ()) for typed in ("delete mover", "", "fly a", "delete arm-1 m", "delete zz", "ls")),
    ],
)
def test_where_there_is_a_choice_it_is_offered_whole(typed: str, offered: tuple[str, ...]) -> None:
    assert candidates(typed, WORDS) == offered
    assert complete(typed, WORDS) is None


@given(typed=st.text(max_size=30))
def test_a_suggestion_begins_with_what_was_typed(typed: str) -> None:
    found = complete(typed, WORDS)
    assert found is None or (found.startswith(typed) and len(found) > len(typed))


def test_verbs_of_two_words_and_values_of_options_are_completed() -> None:
    words = Words(
        {"NAME": ["arm-1"], "CAMERA": ["wrist"], "VIEW": ["cell"]},
        shapes(Where.SHELL),
        everywhere={"realm": "NAME", "json": ""},
    )
    assert complete("wire mo", words) == "wire monitor"
    assert complete("look cell --camera w", words) == "look cell --camera wrist"
    assert complete("rel --re", words) is None
    assert candidates("show --realm lab ", words)[:1] == ("arm-1",)


def test_parameters_are_offered_until_they_have_a_value() -> None:
    words = Words(parameters={"arm-1.go_to": ["x", "y"], "team": ["speed"]})
    assert candidates("call arm-1.go_to x=0.3 ", words)[:1] == ("y=",)
    assert complete("set team s", words) == "set team speed="


# -- lines are completed in the shells themselves, from the registry and from a living realm -------

BASH = """
source <(robotree completion bash)
for line; do
  COMP_LINE="$line" COMP_POINT=${#line}
  _robotree
  echo "${COMPREPLY[*]}"
done
"""
FISH = "robotree completion fish | source; complete -C $argv[1]"


@pytest.fixture
def path_with_robotree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the program onto the search path, as a person who has installed it."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")


def _lines(*words: str) -> list[str]:
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.splitlines()


@pytest.mark.usefixtures("place", "path_with_robotree")
def test_bash_completes_verbs_options_and_words() -> None:
    completed = {
        "robotree ens": "enslave",
        "robotree wire mon": "monitor",
        "robotree recording ": "",  # it may be a file, too
        "robotree ls --vi": "--views",
        "robotree create page.py a": "as",
        "robotree create pag": "",  # bash offers files then
    }
    assert _lines("bash", "-c", BASH, "bash", *completed) == [*completed.values()]


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
@pytest.mark.usefixtures("place", "path_with_robotree")
def test_fish_says_what_a_verb_does() -> None:
    found = _lines("fish", "-c", FISH, "robotree ens")
    assert found == [
        "enslave\tPut a virtual robot on top of another robot: fill its slot, or several of a group"
    ]


@pytest.mark.parametrize("shell", SCRIPTS)
def test_the_scripts_are_read_by_their_shells(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    script = tmp_path / "script"
    script.write_text(SCRIPTS[shell])
    assert _lines(shell, "-n", str(script)) == []


def test_an_unknown_shell_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "csh"]) == USAGE
    assert "'csh' is no shell that is known: bash, zsh, fish" in capsys.readouterr().err


async def test_names_commands_and_parameters_come_from_the_living_realm(place: Path) -> None:
    transport = await join("test", root=place / "robotree")
    registrar = Registrar(transport)
    lookup, agent = (
        LookupService(transport, "lookup-1"),
        RobotAgent(Arm("arm-1"), transport, registrar=registrar),
    )
    await lookup.start()
    await agent.start()

    async def offered(*words: str) -> list[str]:
        done = await asyncio.to_thread(robotree, "completion", "bash", "--realm", "test", "--", *words)
        assert (done.returncode, done.stderr) == (DONE, "")
        return done.stdout.split()

    try:
        assert await offered("show", "") == ["arm-1"]
        assert "arm-1.go_to" in await offered("--calm", "call", "arm-1.g")
        assert "x=" in await offered("call", "arm-1.go_to", "")
        assert await offered("--realm", "nobody-here", "show", "") == []
    finally:
        await agent.close()
        await registrar.close()
        await lookup.close()
        await transport.close()
