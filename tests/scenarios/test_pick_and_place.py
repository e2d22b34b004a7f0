"""The shipped pick-and-place with the demo's arm, and a second arm beside it, typed as page and guide say."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.demo import cast
from robotree.tui.processes.crew import Crew
from tests.command_line import Run, within_realm

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300)]
ROOT = Path(__file__).parents[2]
CHAPTER = ROOT / "docs" / "guide" / "second-arm.md"
FENCED = re.compile(r"^```(?:python (?P<name>\S+))?\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
ADDRESS = "tcp:127.0.0.1:5770"
"""Of the second arm in the guide; here the system chooses a free port."""
PAGE = ROOT / "examples" / "pick_and_place.py"
THERE, BACK = "-20 cm", "-30 cm"


def written(chapter: Path, folder: Path) -> list[str]:
    """Write the pages of a chapter into a folder; returns the lines that are typed."""
    lines: list[str] = []
    for block in FENCED.finditer(chapter.read_text()):
        if block["name"]:
            (folder / block["name"]).write_text(block["body"])
        else:
            lines += block["body"].splitlines()
    return lines


async def typed(run: Run, line: str) -> tuple[int, str]:
    program, *words = shlex.split(line)
    assert program == "robotree"
    code, out, complaints = await run(*words)
    return code, out + complaints


async def test_the_lines_of_the_page_move_the_block_and_it_can_be_brought_back(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    *begin, call = [line for line in PAGE.read_text().splitlines() if line.startswith("robotree ")]
    back = call.replace(THERE, "?").replace(BACK, THERE).replace("?", BACK)
    async with Crew("picking", place) as crew:
        table = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--speedup", "6")
        await crew.start_all(("host", "host-1"), ("proxy", "arm", "arm-1", "--connect", table.address))
        run = within_realm("picking")
        for line in begin:
            assert (await typed(run, line))[0] == exit_codes.DONE
        code, said = await typed(run, call)
        assert code == exit_codes.DONE, said
        assert "gripped" in said
        code, said = await typed(run, call)
        assert code == exit_codes.REFUSED
        assert "nothing is there (x=0.3, y=-0.2)" in said
        code, said = await typed(run, back)
        assert code == exit_codes.DONE, said


@pytest.mark.soak
async def test_the_second_arm_of_the_guide_works_beside_the_first_one(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = written(CHAPTER, tmp_path)
    async with Crew("second-arm", place) as crew:
        await cast(crew, speedup="6")
        run, there, said = within_realm("second-arm"), ADDRESS, ""
        for line in lines:
            words = shlex.split(line)[1:]
            if words[0] == "sim":
                words[words.index(ADDRESS)] = "tcp:127.0.0.1:0"
                there = (await crew.start(*words, "--speedup", "6")).address
            elif words[0] == "proxy":
                await crew.start(*[there if word == ADDRESS else word for word in words])
            else:
                code, said = await typed(run, line)
                assert code == exit_codes.DONE, f"{line}: {said}"
        assert "2 of 2" in said, "both blocks were brought"
