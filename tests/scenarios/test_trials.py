"""Real processes: the trials of the examples hold in the demo's cell, faults end with who began them."""

from __future__ import annotations

import asyncio
import re
import signal
from collections.abc import AsyncIterator
from pathlib import Path

import psutil
import pytest
import pytest_asyncio

from robotree.client.joining import joined
from robotree.tui.line import grammar
from robotree.tui.processes.crew import Crew
from robotree.tui.screen.app import Supervisor
from robotree.vr.base.requests import State
from tests.architecture.test_documents import blocks
from tests.command_line import ROBOTREE, within_realm
from tests.scenarios.conftest import arm_cell
from tests.screen import text_of
from tests.tui.recording.foxglove_client import connected
from tests.waiting import until

pytestmark = pytest.mark.e2e

ROOT = Path(__file__).parents[2]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def cell(shared_place: Path) -> AsyncIterator[Crew]:
    async with Crew("drilled", shared_place) as crew:
        await arm_cell(crew, "2")
        yield crew


def process_of(crew: Crew, *words: str) -> int:
    (member,) = [each for each in crew.members if each.words[: len(words)] == words]
    return member.process.pid


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.usefixtures("cell")
async def test_a_cut_is_on_the_screen_and_ends_with_a_killed_runner(tmp_path: Path) -> None:
    (tmp_path / "a.session").write_text("fault cut arm-1\nsleep 10min\n")
    runner = await asyncio.create_subprocess_exec(
        *ROBOTREE, "run", str(tmp_path / "a.session"), "--realm", "drilled", stderr=asyncio.subprocess.PIPE
    )
    states: list[State] = []
    async with joined("drilled") as realm_client:
        await realm_client.watch_state("arm-1", lambda _, state: states.append(state))
        await until(
            lambda: bool(states) and states[-1].drill.startswith("cut, by ") and not states[-1].online
        )
        async with Supervisor(realm_client, realm="drilled").run_test(size=(100, 30)) as pilot:
            await until(lambda: "DRILL: arm-1 cut, by " in text_of(pilot.app))
        runner.send_signal(signal.SIGKILL)
        await runner.wait()
        await until(lambda: not states[-1].drill and states[-1].online)


@pytest.mark.asyncio(loop_scope="module")
async def test_a_frozen_process_wakes_when_the_runner_is_killed(cell: Crew, tmp_path: Path) -> None:
    host = psutil.Process(process_of(cell, "host"))
    (tmp_path / "a.session").write_text("fault freeze host-1\nsleep 10min\n")
    runner = await asyncio.create_subprocess_exec(
        *ROBOTREE, "run", str(tmp_path / "a.session"), "--realm", "drilled", stderr=asyncio.subprocess.PIPE
    )
    await until(lambda: host.status() == psutil.STATUS_STOPPED)
    runner.send_signal(signal.SIGKILL)
    await runner.wait()
    await until(lambda: host.status() != psutil.STATUS_STOPPED)


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.usefixtures("cell")
async def test_foxglove_is_served_until_it_is_ended() -> None:
    server = await asyncio.create_subprocess_exec(
        *(*ROBOTREE, "foxglove", "--port", "0", "--realm", "drilled"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    assert server.stdout is not None
    word, address = (await server.stdout.readline()).decode().split()
    assert word == "ready"
    async with connected(address) as client:
        await until(lambda: {"/robots/arm-1/get_info", "/robots/arm-1/go_to"} <= client.services.keys())
        await client.call("/robots/arm-1/get_info", 1)
        await until(lambda: 1 in client.answers)
        assert {"x", "y", "z"} <= client.answers[1]["result"].keys()
        server.send_signal(signal.SIGTERM)
        assert await server.wait() == 0


@pytest.mark.asyncio(loop_scope="module")
async def test_the_guide_is_done_as_it_is_written(cell: Crew, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    proxy = process_of(cell, "proxy", "rover")
    lines = [line for block in blocks(ROOT / "docs" / "trials.md", "") for line in block.splitlines()]
    for line in lines:
        _, *words = grammar.split(re.split(r"\s{3,}", line)[0])
        if words[0] == "test" and "--junit" not in words:
            words.append("--collect-only")  # the line with the report moves what all of them move
        process = await asyncio.create_subprocess_exec(
            *(*ROBOTREE, *words, "--realm", "drilled"),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            cwd=tmp_path,
        )
        out, _ = await process.communicate()
        assert process.returncode == 0, f"{line}\n{out.decode()}"
        if "--junit" in words:
            assert "7 passed in " in out.decode()
        elif words[0] == "test":
            chosen = "2 trials" if "lift" in line else "7 trials"
            assert out.decode().splitlines()[-1].startswith(chosen), line
    assert lines[-1].startswith("robotree fault kill rover-1")
    assert 'tests="7"' in (tmp_path / "trials.xml").read_text()
    await until(lambda: not psutil.pid_exists(proxy) or psutil.Process(proxy).status() == "zombie")
    code, _, complaints = await within_realm("drilled")("fault", "kill", "rover-1")
    assert code != 0
    assert complaints.startswith("robotree: ")
