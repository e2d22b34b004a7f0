"""A crew ends when the process that started it ends."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import LONGEST_PAUSE, PAUSE, Crew, Member, pause_after
from robotree.vr.agents.run import RETURNS
from robotree.vr.base.address import ROLES
from tests.command_line import ROBOTREE

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("place")]

STARTER = """
import asyncio, sys
from pathlib import Path
from robotree.tui.processes.crew import Crew

async def main():
    crew = Crew("default", Path(sys.argv[1]))
    member = await crew.start("lookup", "lu-1")
    print(member.pid, flush=True)
    await asyncio.Event().wait()

asyncio.run(main())
"""


def is_running(pid: int) -> bool:
    """Whether the process exists and is not a zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


async def ended(process: int, within: float) -> bool:
    """Wait until the process of a pidfd has ended; the kernel makes it readable then."""
    over = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_reader(process, over.set)
    try:
        async with asyncio.timeout(within):
            return await over.wait()
    finally:
        loop.remove_reader(process)
        os.close(process)


async def test_a_crew_ends_with_its_block(tmp_path: Path) -> None:
    async with Crew("default", tmp_path) as crew:
        members = await crew.start_all(("lookup", "lu-1"), ("host", "h-1"))
        pids = [member.pid for member in members]
        assert all(is_running(pid) for pid in pids)
    assert not any(is_running(pid) for pid in pids)


async def test_a_member_does_not_outlive_a_starter_that_was_killed(tmp_path: Path) -> None:
    starter = await asyncio.create_subprocess_exec(
        sys.executable, "-c", STARTER, str(tmp_path), stdout=asyncio.subprocess.PIPE
    )
    assert starter.stdout
    pid = int(await starter.stdout.readline())
    member = os.pidfd_open(pid)
    os.kill(starter.pid, signal.SIGKILL)
    await starter.wait()
    assert await ended(member, within=60)


async def test_a_member_that_cannot_start_says_why_in_one_sentence(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        async with Crew("default", tmp_path) as crew:
            with pytest.raises(MemberFailed) as failure:
                await crew.start("sim", "rover", "--listen", f"tcp:127.0.0.1:{port}")
    sentence = str(failure.value)
    assert str(port) in sentence
    assert "\n" not in sentence
    assert "Traceback" not in sentence


async def test_a_demo_that_is_killed_leaves_nothing_behind(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary, state = place.with_name("tmp"), place.with_name("state")
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    demo = await asyncio.create_subprocess_exec(
        *(*ROBOTREE, "demo", "--headless", "--realm", "killed"),
        cwd=tmp_path,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    assert demo.stdout
    await demo.stdout.readline()  # the first step of its script: everybody is up
    members = children(demo.pid)
    assert len(members) == 8, "two controllers, two proxies, a view, two lookup services, a host"
    handles = [os.pidfd_open(pid) for pid in members]
    demo.kill()
    await demo.wait()
    assert all(await asyncio.gather(*(ended(handle, 60) for handle in handles)))
    async with joined("killed") as realm_client:
        assert not any(realm_client.directory.present(role) for role in ROLES)
    left = {path.name for path in (place / "robotree" / "killed").iterdir()}
    assert left == {"realm.key", "realm.key.time"}, "no socket; the key stays for the next"
    assert list(temporary.iterdir()) == []
    kept = {str(path.relative_to(state)) for path in state.glob("robotree/*/*")}
    assert kept == {"robotree/demos/killed"}, "which the next demo of the realm removes"


def children(pid: int) -> list[int]:
    """The processes that this one has started."""
    living = (int(one.name) for one in Path("/proc").iterdir() if one.name.isdigit())
    return [one for one in living if parent(one) == pid]


def parent(pid: int) -> int:
    """The process that started this one; 0: it has gone."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return 0


async def again(crew: Crew, member: Member) -> Member:
    """Kill a member, and wait until it is up again."""
    os.kill(member.pid, signal.SIGKILL)

    def found() -> Member | None:
        same = (one for one in crew.members if one.words == member.words_again and one.address)
        return next((one for one in same if one.pid != member.pid), None)

    async with asyncio.timeout(60):
        while (new := found()) is None:  # noqa: ASYNC110 # nobody tells
            await asyncio.sleep(0.02)
    return new


async def test_a_member_that_crashes_is_started_again_where_it_was(tmp_path: Path) -> None:
    async with Crew("default", tmp_path, restarts=True) as crew:
        rover, host = await crew.start_all(
            ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none"), ("host", "h-1")
        )
        assert (await again(crew, rover)).address == rover.address
        for _ in range(2):
            host = await again(crew, host)
        assert len(crew.members) == 2
        os.kill(host.pid, signal.SIGTERM)
        assert await host.process.wait() == 0, "it was asked to end: that is no crash"
        host = await crew.start("host", "h-1")
    assert not is_running(host.pid)


def test_the_first_crash_costs_no_pause_and_no_pause_is_longer_than_children_wait() -> None:
    pauses = [pause_after(crashes) for crashes in range(1, 50)]
    assert pauses[:3] == [0.0, PAUSE, 2 * PAUSE]
    assert pauses == sorted(pauses)
    assert pauses[-1] == LONGEST_PAUSE
    assert LONGEST_PAUSE <= RETURNS / 2, "the other half is for the start"


def test_a_demo_whose_host_is_killed_closes_its_lever(tmp_path: Path) -> None:
    words = [
        *ROBOTREE,
        "demo",
        "--crash",
        "--headless",
        "--speedup",
        "2",
        "--pictures",
        str(tmp_path / "here"),
    ]
    played = subprocess.run(words, capture_output=True, text=True, timeout=180, check=False)
    assert played.returncode == exit_codes.DONE, played.stdout + played.stderr
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert (verdict["ok"], verdict["kills"], verdict["continued"]) == (True, 2, 2)
    assert (verdict["twice"], verdict["lost"], verdict["doubts"]) == (0, 0, 0)


async def test_a_crew_leaves_what_crashes_down_unless_it_is_told_otherwise(tmp_path: Path) -> None:
    async with Crew("default", tmp_path) as crew:
        member = await crew.start("lookup", "lu-1")
        os.kill(member.pid, signal.SIGKILL)
        await asyncio.gather(*crew._watches)  # they would go on
        assert crew.members == [member]
