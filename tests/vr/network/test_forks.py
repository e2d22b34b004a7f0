"""Pages that fork: the child keeps nothing of its parent's and runs its own code; coming back it ends."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from robotree.files.forks import CODE
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.promises import until
from tests.vr.network.conftest import Enter, Process, Start

PAGE = '''
import concurrent.futures, contextlib, logging, multiprocessing, os
import subprocess, sys, threading, time, warnings
from robotree.vr import Child, VirtualRobot, command, state

fork = multiprocessing.get_context("fork")

def code_of(pid):
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])

def double(x):
    print("doubled", x)
    return 2 * x

class Forker(VirtualRobot):
    """Forks."""

    rover = Child("Rover")
    count: int = state(3)

    @command
    def comes_back(self, way: str) -> int:
        """Have a child come back into robotree; return its exit code."""
        pid = os.fork()
        if pid:
            return code_of(pid)
        if way == "returns":
            return 0
        if way == "raises":
            raise ValueError("in the child")
        if way == "exits":
            sys.exit(0)
        if way == "sleeps":
            self.sleep(0.1)
        if way == "reports":
            self.progress(0.5, "half")
        if way == "calls":
            self.rover.move(x=1.0)
        if way == "starts":
            self.rover.move.start(x=1.0)
        if way == "changes":
            self.count = 4
        if way == "together":
            with self.together() as both:
                both.start(self.rover.move, x=1.0)
        if way == "swallows":
            with contextlib.suppress(BaseException):
                self.rover.move(x=1.0)
        os._exit(1)

    @command
    def stays(self, way: str) -> int:
        """Have a child run its own code only; return its exit code."""
        if way == "process":
            child = fork.Process(target=double, args=(2,))
            child.start()
            child.join()
            return child.exitcode
        if way == "pool":
            with concurrent.futures.ProcessPoolExecutor(2, fork) as pool:
                return sum(pool.map(double, range(10))) - 90
        if way == "terminated":
            child = fork.Process(target=time.sleep, args=(30,))
            child.start()
            child.terminate()
            child.join()
            return child.exitcode
        if way == "command":
            return subprocess.run(["true"], preexec_fn=int).returncode
        pid = os.fork()
        if pid:
            return code_of(pid)
        if way == "prints":
            print("from the child")
            logging.getLogger("page").error("from the child")
            warnings.warn("from the child")
        if way == "reads":
            assert self.count == 3 and self.name == "forker"
        if way == "threads":
            with concurrent.futures.ThreadPoolExecutor() as pool:
                assert list(pool.map(double, range(3))) == [0, 2, 4]
        os._exit(0)

    @command
    def at_work(self) -> int:
        """Fork again and again while other threads print; return how many children did not end well."""
        done = threading.Event()

        def talk():
            while not done.is_set():
                print("talk")
        threads = [threading.Thread(target=talk) for _ in range(3)]
        for thread in threads:
            thread.start()
        try:
            return sum(self.stays(way="reads") != 0 for _ in range(30))
        finally:
            done.set()

    @command
    def leaves(self, seconds: float) -> int:
        """Leave a child behind that has a pipe of its own; return its process."""
        reads, writes = os.pipe()
        pid = os.fork()
        if pid == 0:
            time.sleep(seconds)
            os._exit(0)
        self.pipe = reads, writes
        return pid
'''
BACK = (
    *("returns", "raises", "exits", "sleeps", "reports", "calls", "starts", "changes", "together"),
    "swallows",
)
STAYS = {
    **dict.fromkeys(("process", "pool", "command", "prints", "reads", "threads"), 0),
    "terminated": -signal.SIGTERM,
}

OF_A_LOOP = 2
"""Sockets by which an event loop wakes itself: the child has them, and never enters the loop."""
OF_THE_STARTER = 3
"""Standard input, output and error."""

Call = Callable[..., Awaitable[Any]]


@pytest.fixture
async def host(start: Start) -> Process:
    process = await start("host", "h1")
    await process.ready()
    return process


@pytest.fixture
async def call(start: Start, host: Process, join_realm: Enter, tmp_path: Path) -> AsyncIterator[Call]:
    """Call a command of a robot in a host that is a process of its own."""
    assert host.process.returncode is None
    rover = await start("robot", "rover")
    await rover.ready()
    realm_client = RealmClient(await join_realm())
    await realm_client.start()
    (tmp_path / "forker.py").write_text(PAGE)
    await realm_client.create(str(tmp_path / "forker.py"), "forker")
    await realm_client.enslave("forker", "rover", "rover")

    async def call(command: str, **arguments: object) -> Any:
        return await realm_client.call("forker", command, arguments, deadline=120)

    yield call
    await realm_client.close()


async def test_a_child_that_comes_back_into_robotree_ends_there_and_its_parent_goes_on(
    call: Call, host: Process
) -> None:
    assert {way: await call("comes_back", way=way) for way in BACK} == dict.fromkeys(BACK, CODE)
    code, complaints = await host.end()
    assert code == 0
    assert complaints.count("came back into robotree and ends") == len(BACK)


async def test_a_child_that_runs_its_own_code_is_left_alone_and_the_host_lives(call: Call) -> None:
    assert {way: await call("stays", way=way) for way in STAYS} == STAYS
    assert await call("stays", way="reads") == 0


async def test_no_lock_that_another_thread_held_holds_up_a_child(call: Call) -> None:
    assert await call("at_work") == 0


def opened(pid: int) -> list[str]:
    found = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found.append(str(link.readlink()))
        except FileNotFoundError:
            continue
    return found


async def test_a_child_has_its_own_pipe_and_no_socket_of_robotree(call: Call, host: Process) -> None:
    pid = await call("leaves", seconds=20.0)
    try:
        assert sum("socket:" in one for one in opened(host.process.pid)) > OF_A_LOOP
        await until(lambda: sum("socket:" in one for one in opened(pid)) == OF_A_LOOP, "it has none of ours")
        child = opened(pid)
        assert not [one for one in child if one.endswith((".beat", ".sock", ".held"))], child
        assert sum("pipe:" in one for one in child) == OF_THE_STARTER + 2, child
    finally:
        os.kill(pid, signal.SIGKILL)


@pytest.mark.speed
async def test_the_death_of_a_process_is_seen_at_once_though_its_child_lives(
    call: Call, host: Process, join_realm: Enter
) -> None:
    pid = await call("leaves", seconds=20.0)
    transport = await join_realm()
    await until(lambda: bool(transport.presence.keys("robot/forker/*")), "it is seen")
    gone: list[float] = []
    transport.presence.watch(
        "robot/forker/*", lambda _, there: None if there else gone.append(time.perf_counter())
    )
    killed = time.perf_counter()
    host.signal(signal.SIGKILL)
    await until(lambda: bool(gone), "its end is seen")
    assert gone[0] - killed < 0.5
    os.kill(pid, 0)
    os.kill(pid, signal.SIGKILL)
