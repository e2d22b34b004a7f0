"""docs/bring-your-own-robot.md, done as it says: a kind of robot in a file, before the controller in C."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from robotree.tui import exit_codes
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm

pytestmark = pytest.mark.e2e

GUIDE = Path(__file__).parents[3] / "docs" / "bring-your-own-robot.md"
REALM = "guide"
robotree = within_realm(REALM)


def page() -> str:
    """The kind of robot that the guide shows, whole."""
    text, *_ = re.findall(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    return text


async def answer(*words: str) -> Any:
    code, out, err = await robotree(*words, "--json")
    assert code == exit_codes.DONE, err
    return json.loads(out or "null")


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    async with Crew(REALM, place) as crew:
        await crew.start("lookup", "lu-1")
        yield crew


async def test_a_kind_in_a_file_is_driven_by_the_command_line_over_tcp(
    crew: Crew, tmp_path: Path, power: Callable[..., AbstractContextManager[int]]
) -> None:
    file = tmp_path / "conveyor.py"
    file.write_text(page())
    with power() as port:
        await crew.start("proxy", str(file), "belt-1", "--connect", f"tcp:127.0.0.1:{port}")
        await until_online()
        await answer("call", "belt-1.advance", "distance=30 cm", "speed=0.5")
        info = await answer("call", "belt-1.get_info")
        assert info == {"position": pytest.approx(0.3, abs=1e-6), "speed": 0.0}

        code, _, said = await robotree("call", "belt-1.advance", "distance=2.5")
        assert code == exit_codes.REFUSED
        assert "distance: 2.5 is out of range; give a number in m from -2 to 2" in said
        code, _, said = await robotree("call", "belt-1.advance", "distance=1.9")
        assert "belt-1.advance failed: The floor ends 1.5 m from its middle" in said

        assert (await robotree("stop", "belt-1"))[0] == exit_codes.DONE
        code, _, said = await robotree("call", "belt-1.advance", "distance=0.1")
        assert "belt-1 is stopped" in said
        assert (await robotree("resume", "belt-1"))[0] == exit_codes.DONE
        await answer("call", "belt-1.advance", "distance=-0.3", "speed=0.5")

        shown = await answer("show", "belt-1")
        assert shown["kinds"] == ["Conveyor", "RobotProxy", "Robot"]
        assert {one["name"] for one in shown["commands"]} == {"advance", "get_info", "halt"}
        assert {"position": "m", "speed": "m/s", "age": "s"}.items() <= shown["units"].items()
        _, told, _ = await robotree("watch", "belt-1", "--within", "2 s")
        assert re.search(r"position=\S+ m +speed=\S+ m/s", told)


async def test_a_file_that_is_no_kind_is_refused_in_one_sentence(crew: Crew, tmp_path: Path) -> None:
    file = tmp_path / "empty.py"
    file.write_text("")
    with pytest.raises(
        MemberFailed, match=r"empty\.py defines no kind of robot; it needs a class that derives"
    ):
        await crew.start("proxy", str(file), "belt-1", "--connect", "tcp:127.0.0.1:1")


async def until_online() -> None:
    async with asyncio.timeout(60):
        while not (await answer("show", "belt-1")).get("online", True):
            pass
