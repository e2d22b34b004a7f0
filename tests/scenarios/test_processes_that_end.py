"""A crew ends with the process that started it, and a host also while a page holds its interpreter."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import time
from collections.abc import AsyncGenerator, AsyncIterator
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.errors import MemberFailed
from robotree.tui.processes import guard
from robotree.tui.processes.crew import LONGEST_PAUSE, PAUSE, Crew, Member, pause_after
from robotree.tui.processes.ending import LAST_WORDS
from robotree.vr.agents.run import RETURNS
from robotree.vr.base.address import ROLES
from tests.command_line import ROBOTREE, within_realm
from tests.soak.stage import holds
from tests.terminal import children, living
from tests.waiting import until

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
        assert all(living(pid) for pid in pids)
    assert not any(living(pid) for pid in pids)


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
    assert not living(host.pid)


def test_the_first_crash_costs_no_pause_and_no_pause_is_longer_than_children_wait() -> None:
    pauses = [pause_after(crashes) for crashes in range(1, 50)]
    assert pauses[:3] == [0.0, PAUSE, 2 * PAUSE]
    assert pauses == sorted(pauses)
    assert pauses[-1] == LONGEST_PAUSE
    assert LONGEST_PAUSE <= RETURNS / 2, "the other half is for the start"


async def test_a_crew_leaves_what_crashes_down_unless_it_is_told_otherwise(tmp_path: Path) -> None:
    async with Crew("default", tmp_path) as crew:
        member = await crew.start("lookup", "lu-1")
        os.kill(member.pid, signal.SIGKILL)
        await asyncio.gather(*crew._watches)  # they would go on
        assert crew.members == [member]


# -- a page that holds the interpreter in one call into C, so that no thread of its host runs -----

REALM = "held"
robotree = within_realm(REALM)
PAGE = '''
"""Greedy: holds the interpreter."""
import ctypes
import os
import signal
import time
from pathlib import Path
from robotree.vr import VirtualRobot, command

class Greedy(VirtualRobot):
    """Stays in C."""

    @command
    def hold(self) -> None:
        """Take a lock a second time, and wait for it in vain, with the interpreter held: for ever."""
        libc, lock = ctypes.PyDLL(None), ctypes.create_string_buffer(64)
        libc.pthread_mutex_lock(lock)
        Path(os.environ["XDG_RUNTIME_DIR"], f"held-{os.getpid()}").touch()
        libc.pthread_mutex_lock(lock)

    @command(effect="read")
    def count(self) -> int:
        """Return a number."""
        return 1

    @command(effect="read")
    def beget(self) -> None:
        """Fork, and end the child by a signal."""
        if not (child := os.fork()):
            time.sleep(60)
            os._exit(0)
        time.sleep(0.5)
        os.kill(child, signal.SIGTERM)
        time.sleep(0.5)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
'''
HARD = guard.LIMIT + 60.0
"""[s] until a process that holds its interpreter has ended; the machine may be busy."""


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    """A host with a robot that can hold the interpreter."""
    (place / "greedy.py").write_text(PAGE)
    async with Crew(REALM, place) as crew:
        await crew.start("host", "host-1")
        code, _, complaints = await robotree("create", str(place / "greedy.py"), "as", "greedy")
        assert code == 0, complaints
        yield crew
        for pid in process_of("apart-host").split():  # left by a test that failed
            os.kill(int(pid), signal.SIGKILL)


@contextlib.asynccontextmanager
async def held(pid: int, robot: str = "greedy") -> AsyncGenerator[None]:
    """Hold the interpreter of a host: its network thread gives no sign of life."""
    runtime = Path(os.environ["XDG_RUNTIME_DIR"])
    beat = next((runtime / "robotree" / REALM).glob(f"{pid}-*.beat"))
    caller = await asyncio.create_subprocess_exec(
        *(*ROBOTREE, "call", f"{robot}.hold", "--realm", REALM),
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        await until((runtime / f"held-{pid}").exists)

        async def silent() -> bool:
            sign = beat.read_bytes()
            await asyncio.sleep(1.2)  # more than two beats
            return sign == beat.read_bytes()

        await until(silent)
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            caller.kill()
        await caller.wait()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_a_signal_ends_a_host_whose_page_holds_the_interpreter(
    crew: Crew, number: signal.Signals
) -> None:
    host = crew.members[0]
    async with held(host.pid):
        guards, began = children(host.pid), time.monotonic()
        handles = [os.pidfd_open(one) for one in (host.pid, *guards)]
        os.kill(host.pid, number)
        assert all(await asyncio.gather(*(ended(handle, HARD) for handle in handles)))
        assert time.monotonic() - began >= LAST_WORDS, "it had the time for an orderly end"
    assert f"process {host.pid} was killed: it did not end within 3.5 s" in host.log


async def test_it_does_not_outlive_its_starter(crew: Crew) -> None:
    host = crew.members[0]
    async with held(host.pid):
        handle = os.pidfd_open(host.pid)
        assert host.process.stdin is not None
        host.process.stdin.close()  # as the kernel does when the starter is killed
        assert await ended(handle, HARD)


@pytest.mark.speed
async def test_an_orderly_end_is_as_quick_as_without_a_guard(crew: Crew) -> None:
    host = crew.members[0]
    (watcher,) = children(host.pid)
    os.kill(watcher, signal.SIGTERM)  # service managers send it to all processes of a service
    assert living(watcher)
    began, handles = time.monotonic(), [os.pidfd_open(host.pid), os.pidfd_open(watcher)]
    os.kill(host.pid, signal.SIGTERM)
    assert all(await asyncio.gather(*(ended(handle, HARD) for handle in handles)))
    assert time.monotonic() - began < LAST_WORDS
    assert await host.process.wait() == 0
    assert "killed" not in host.log


async def test_a_guard_that_was_killed_takes_nothing_with_it(crew: Crew) -> None:
    host = crew.members[0]
    (watcher,) = children(host.pid)
    os.kill(watcher, signal.SIGKILL)
    code, out, _ = await robotree("call", "greedy.count")
    assert (code, out) == (0, "1\n")
    handle = os.pidfd_open(host.pid)
    os.kill(host.pid, signal.SIGTERM)
    assert await ended(handle, HARD)
    assert "BrokenPipe" not in host.log


async def test_a_host_that_was_killed_leaves_no_guard(crew: Crew) -> None:
    host = crew.members[0]
    (watcher,) = children(host.pid)
    handle = os.pidfd_open(watcher)
    os.kill(host.pid, signal.SIGKILL)
    assert await ended(handle, HARD)


async def test_the_end_of_a_forked_child_is_not_that_of_its_host(crew: Crew) -> None:
    host = crew.members[0]
    code, _, complaints = await robotree("call", "greedy.beget")
    assert code == 0, complaints
    with pytest.raises(TimeoutError):
        await ended(os.pidfd_open(host.pid), guard.LIMIT + 1.0)


KIND = '''"""A rover of one's own."""
from robotree.proxy.rover import Rover
from robotree.vr import command

class Mine(Rover):
    """A rover."""

    @command
    def again(self) -> None:
        """Do nothing."""
'''


async def test_a_proxy_never_shares_a_process_with_pages(crew: Crew, place: Path) -> None:
    """No page can be put into the process of a proxy, and no proxy into that of a page."""
    kind = place / "mine.py"
    kind.write_text(KIND)
    rover = await crew.start("sim", "rover", "--listen", "tcp:127.0.0.1:0")
    proxy = await crew.start("proxy", str(kind), "rover-1", "--connect", rover.address)
    code, _, complaints = await robotree("create", str(place / "greedy.py"), "as", "guest", "on", "rover-1")
    assert (code, "no host" in complaints) == (exit_codes.REFUSED, True), complaints
    code, _, complaints = await robotree("create", str(kind), "as", "guest")
    assert (code, "defines no virtual robot" in complaints) == (exit_codes.REFUSED, True), complaints
    code, _, complaints = await robotree("create", str(place / "greedy.py"), "as", "guest")
    assert code == 0, complaints
    async with joined(REALM) as realm_client:
        found = realm_client.held()
    agents = {
        member.pid: {one.key.rpartition("/")[0] for one in found if one.where == f"process {member.pid}"}
        for member in (crew.members[0], proxy)
    }
    assert list(agents.values()) == [{"host/host-1", "robot/greedy", "robot/guest"}, {"robot/rover-1"}]
    async with held(crew.members[0].pid):
        code, _, complaints = await robotree("call", "rover-1.move", "x=0.1", "y=0", "--within", "20 s")
        assert code == 0, complaints


def process_of(host: str) -> str:
    """The process id of a host, as text; empty: it does not run."""
    found: list[str] = []
    for one in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            words = (one / "cmdline").read_bytes().split(b"\0") if one.name.isdigit() else []
            if host.encode() in words and b"host" in words:
                found.append(one.name)
    return " ".join(found)


@pytest.mark.usefixtures("crew")
async def test_a_robot_in_a_process_of_its_own_holds_no_other(place: Path) -> None:
    code, out, complaints = await robotree("create", str(place / "greedy.py"), "as", "apart", "--own-host")
    assert (code, out) == (0, "apart (Greedy) runs on apart-host\n"), complaints
    _, out, _ = await robotree("ls", "--hosts")
    rows = [line.split() for line in out.splitlines()[1:]]
    assert [(row[0], row[-1]) for row in rows] == [("apart-host", "apart"), ("host-1", "greedy")]
    code, _, complaints = await robotree("create", str(place / "greedy.py"), "as", "apart", "--own-host")
    assert (code, complaints) == (
        1,
        "robotree: a robot named 'apart' is already running; choose another name or end that one first\n",
    )
    pid = int(process_of("apart-host"))
    handle = os.pidfd_open(pid)
    async with held(pid, "apart"):
        code, out, complaints = await robotree("call", "greedy.count")
        assert (code, out) == (0, "1\n"), complaints
        code, _, complaints = await robotree("show", "apart")
        assert code == exit_codes.NOBODY
        assert f"`kill {pid}` ends it" in complaints
        os.kill(pid, signal.SIGTERM)
        assert await ended(handle, HARD)


@pytest.mark.usefixtures("crew")
async def test_a_process_of_its_own_ends_with_its_robot(place: Path) -> None:
    page = str(place / "greedy.py")
    assert (await robotree("create", page, "as", "apart", "--own-host"))[0] == 0
    handle = os.pidfd_open(int(process_of("apart-host")))
    code, out, _ = await robotree("delete", "apart")
    assert (code, out) == (0, "apart is deleted\n")
    assert await ended(handle, HARD)
    code, _, complaints = await robotree("create", f"{page}:None", "as", "apart", "--own-host")
    assert (code, "defines no virtual robot" in complaints) == (1, True)
    async with joined(REALM) as realm_client:
        assert await holds(
            lambda: [one.name for one in realm_client.directory.present("host")] == ["host-1"], HARD
        )
