"""The shipped pick-and-place in the demo's own cell, typed as its page says."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.demo import cast
from robotree.tui.processes.crew import Crew
from tests.command_line import Run, within_realm

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300)]
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "examples" / "pick_and_place.py"
THERE, BACK = "-20 cm", "-30 cm"


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
        await cast(crew, speedup="3")
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
