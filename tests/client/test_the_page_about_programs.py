"""Each program of docs/programs.md runs as it is written, at a simulated arm with its real proxy."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.command_line import ROBOTREE

pytestmark = pytest.mark.e2e

PAGE = Path(__file__).parents[2] / "docs" / "programs.md"
EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)


@pytest.fixture(scope="module")
def arm(shared_place: Path) -> Iterator[Path]:
    """A lookup service, a host, a quick simulated arm and its proxy `arm-1`; gives a folder for programs."""
    members: list[subprocess.Popen[str]] = []

    def start(*words: str) -> str:
        process = subprocess.Popen(
            [*ROBOTREE, *words, "--tether"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        members.append(process)
        assert process.stdout is not None
        ready, _, address = process.stdout.readline().strip().partition(" ")
        assert ready == "ready"
        return address

    start("lookup", "l1")
    start("host", "h1", "--forget")
    address = start("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--speedup", "6", "--open")
    start("proxy", "arm", "arm-1", "--connect", address, "--open")
    folder = shared_place / "programs"  # beside the realms' folder, `robotree`, they would import that
    folder.mkdir()
    shutil.copy(EXAMPLES / "move_to.py", folder)
    yield folder
    for member in members:
        assert member.stdin is not None
        assert member.stdout is not None
        member.stdin.close()
        member.wait(30)
        member.stdout.close()


@pytest.mark.parametrize("number", range(len(PROGRAMS)))
def test_a_program_of_the_page_runs(arm: Path, number: int) -> None:
    text = PROGRAMS[number]
    if "async def main" in text:
        text += "\n\nimport asyncio\n\nasyncio.run(main())\n"
    program = arm / f"test_program_{number}.py"
    program.write_text(text)
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider"] if "def test_" in text else []
    done = subprocess.run(
        [sys.executable, *words, str(program)], cwd=arm, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    if "could not" in text:  # each branch of the example is taken
        assert "refused before anything moved: " in done.stdout
        assert "the robot could not: " in done.stdout


def test_the_page_has_programs() -> None:
    assert len(PROGRAMS) == 6
