"""Lines are completed in the shells themselves, from the registry and from a living realm."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from robotree.tui.cli import main
from robotree.tui.exit_codes import DONE, USAGE
from robotree.tui.line.shells import SCRIPTS
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from tests.command_line import robotree
from tests.tui.conftest import Arm

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
