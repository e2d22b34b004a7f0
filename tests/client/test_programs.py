"""A program sees and commands a living realm: real processes, as a script or a notebook uses them."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest

from robotree import connect, connect_async
from robotree.client import asynchronous
from robotree.client.blocking import Realm
from robotree.vr import (
    BadArgument,
    CommandCancelled,
    CommandFailed,
    DeadlineExceeded,
    Kind,
    Range,
    Unit,
    promised,
)
from robotree.vr.base.errors import (
    BadName,
    EmptyRealm,
    NobodyAttends,
    NoSuchRobot,
    NotAttended,
    NotInControl,
    NotPaused,
    NotThisKind,
    TransportClosed,
)
from robotree.vr.core.machine import ATTENTION
from robotree.vr.network.realms import all_realms, robots_in
from tests.command_line import ROBOTREE, ran
from tests.waiting import wait_until

pytestmark = pytest.mark.e2e

WALKER = """
from typing import Annotated
from robotree.vr import Child, Failed, Range, Unit, VirtualRobot, command, state

class Walker(VirtualRobot):
    "Walks a line."

    at: float = state(0.0)
    stride: Annotated[float, Unit("m")] = 0.5

    def readings(self) -> dict[str, float]:
        return {"x": self.at}

    @command
    def walk(self, x: Annotated[float, Unit("m"), Range(-10, 10)], steps: int = 1) -> float:
        "Walk to a place."
        for step in range(steps):
            self.at += (x - self.at) / (steps - step)
            self.progress((step + 1) / steps, f"step {step + 1}")
            self.sleep(0.05 if steps > 1 else 0)
        return self.at

    @command
    def where(self) -> dict[str, float]:
        return {"x": self.at, "stride": self.stride}

    @command(attended=True)
    def march(self) -> None:
        while True:
            self.at += 1.0
            self.sleep(0.05)

    @command
    def stumble(self) -> None:
        raise Failed("a stone", stone=3)

class Leader(VirtualRobot):
    walker = Child("Walker")
    walk = walker.exposed()
"""

SOON = 60.0
"""[s] for news to arrive."""


class Walker(Kind):
    """What the page promises."""

    @promised()
    def walk(self, x: Annotated[float, Unit("m"), Range(-10, 10)], steps: int = 1) -> float:
        """Walk to a place."""
        raise NotImplementedError


class Swimmer(Kind):
    """Another kind."""


@contextlib.contextmanager
def member(*words: str) -> Generator[str]:
    """A process of the realm, which ends with the block; gives the address at which it listens."""
    command = [*ROBOTREE, *words, "--tether"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        ready, _, address = process.stdout.readline().strip().partition(" ")
        assert ready == "ready"
        yield address


@pytest.fixture(scope="module")
def realm_of_processes(shared_place: Path) -> Iterator[Path]:
    """A lookup service and a host in processes of their own; gives the folder with the page."""
    with member("lookup", "l1"), member("host", "h1"):
        page = shared_place / "walker.py"
        page.write_text(WALKER)
        yield page


@pytest.fixture
def realm(realm_of_processes: Path) -> Iterator[Realm]:
    """A realm with a robot `ann`, and nobody else at the end."""
    with connect() as realm:
        realm.create(str(realm_of_processes), "ann", wanted="Walker")
        yield realm
        for robot in realm.tree():
            if robot.bond is None:
                realm.delete(robot.name)
        for robot in realm.tree():
            realm.delete(robot.name)


def test_the_robots_of_a_realm_are_short_in_a_notebook_and_printed_as_trees(
    realm: Realm, realm_of_processes: Path
) -> None:
    realm.create(str(realm_of_processes), "leader", wanted="Leader")
    assert repr(realm.tree()) == "<2 robots: ann, leader>"
    assert str(realm.tree()) == "ann (Walker)\nleader (Leader)\n└─ walker: empty (Walker)"
    realm.enslave("leader.walker", "ann")
    assert str(realm.tree()) == "leader (Leader)\n└─ walker: ann (Walker)"
    assert [robot.name for robot in realm.tree()] == ["leader", "ann"]
    assert repr(realm.ls()).startswith("<")


def test_a_realm_in_which_nobody_is_names_those_that_have_robots(realm: Realm) -> None:
    wait_until(lambda: any("ann" in robots_in(folder) for folder in all_realms()), "it is written down")
    with connect("nobodys") as elsewhere:
        named = rf"in realm 'nobodys', but there is .*{realm.name} \([^)]*\bann\b"
        for look in (elsewhere.ls, elsewhere.tree):
            with pytest.raises(EmptyRealm, match=named):
                look()


CALLS = {
    "realm['ann'].stumble()": "a stone",
    "realm['ann'].walk(99, steps=2)": "walk: x",
    "realm['bob'].walk(x=1)": "no robot named 'bob'",
}
BLOCKING = """import traceback, robotree
with robotree.connect() as realm:"""
WITH_ASYNCIO = """import asyncio, traceback, robotree
async def main():
  async with robotree.connect_async() as realm:"""
TRIED = """
    try: {}
    except Exception: traceback.print_exc()"""


@pytest.mark.parametrize(
    ("begin", "waits", "end"), [(BLOCKING, "", ""), (WITH_ASYNCIO, "await ", "\nasyncio.run(main())")]
)
def test_the_traceback_of_a_program_is_its_own_line_and_a_sentence(
    realm: Realm, begin: str, waits: str, end: str
) -> None:
    assert realm.name
    program = begin + "".join(TRIED.format(waits + call) for call in CALLS) + end
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stderr
    nothing, *traces = told.split("Traceback (most recent call last):")
    assert nothing == ""
    for trace, sentence in zip(traces, CALLS.values(), strict=True):
        *lines, last = trace.strip().splitlines()
        files = [line for line in lines if line.startswith("  File ")]
        ours = [line for line in files if "<string>" not in line and "/asyncio/" not in line]
        assert sentence in last, trace
        assert len(ours) <= 2, trace


def test_a_command_is_called_as_in_a_page_and_returns_its_result(realm: Realm) -> None:
    ann = realm["ann"]
    assert ann.walk(x=2) == 2.0
    assert ann.walk("150 cm") == 1.5
    assert ann.walk(3, steps=2, within="5 s") == 3.0
    where = ann.where()
    assert (where.x, where["stride"]) == (3.0, 0.5)
    assert str(ann) == "ann"
    assert repr(ann) == "<robot ann of realm default>"


def test_errors_have_the_classes_and_the_words_that_a_page_gets(realm: Realm) -> None:
    ann = realm["ann"]
    with pytest.raises(CommandFailed, match="a stone"):
        ann.stumble()
    with pytest.raises(BadArgument, match=r"x.*10"):
        ann.walk(x=11)
    with pytest.raises(BadArgument, match="x: cannot travel: a whole number has 64 bits at most"):
        ann.walk(x=10**400)
    with pytest.raises(BadArgument, match="steps: cannot travel: a whole number has 64 bits at most"):
        ann.walk(x=1, steps=-(2**63) - 1)
    with pytest.raises(BadArgument, match="1: cannot travel"):
        ann.walk(10**400)
    with pytest.raises(BadArgument, match=r"too many; it takes 2 \(x, steps\)"):
        ann.walk(1, 2, 3)
    with pytest.raises(BadArgument, match="x: is given twice"):
        ann.walk(1, x=2)
    with pytest.raises(BadArgument, match="within"):
        ann.walk(1, within="soon")
    with pytest.raises(DeadlineExceeded):
        ann.walk(1, steps=100, within=0.2)
    with pytest.raises(NoSuchRobot, match="bob"):
        realm["bob"].walk(x=1)
    with pytest.raises(BadName):
        realm["no name"]


def test_a_program_attends_a_command_as_long_as_its_key_is_held(realm: Realm) -> None:
    ann, held = realm["ann"], True
    with pytest.raises(NobodyAttends):
        ann.march()
    with ann.march.attended(lambda: held) as march:
        wait_until(lambda: ann.readings.x > 1.2 * ATTENTION / 0.05 or march.done, "it goes on")
        assert not march.done
        held = False
        with pytest.raises(CommandCancelled):
            march.result(SOON)


def test_a_command_that_is_attended_ends_with_its_block_and_with_a_key_that_cannot_be_read(
    realm: Realm,
) -> None:
    ann = realm["ann"]
    with ann.march.attended(lambda: True) as march:
        wait_until(lambda: ann.readings.x > 0, "it has begun")
    assert march.done
    unplugged = pytest.raises(OSError, match="unplugged")
    with unplugged, ann.march.attended(_unplugged) as march, pytest.raises(CommandCancelled):
        march.result(SOON)


def test_a_command_that_would_go_on_without_a_key_is_not_attended(realm: Realm) -> None:
    ann = realm["ann"]
    with pytest.raises(NotAttended, match="would go on without a key"), ann.walk.attended(lambda: True, 1):
        pass
    assert ann.readings.x == 0


def _unplugged() -> bool:
    raise OSError("unplugged")


def test_a_command_runs_while_the_program_does_something_else(realm: Realm) -> None:
    walk = realm["ann"].walk.start(x=1, steps=20)
    assert math.isnan(walk.progress) or walk.progress < 1
    with pytest.raises(TimeoutError):
        walk.result(timeout=0.1)
    assert not walk.done
    assert walk.result() == pytest.approx(1.0)
    assert (walk.progress, walk.note) == (1.0, "step 20")
    assert walk.result() == pytest.approx(1.0), "it can be asked again"


def test_a_command_that_is_cancelled_says_so(realm: Realm) -> None:
    walk = realm["ann"].walk.start(x=1, steps=1000)
    walk.cancel()
    with pytest.raises(CommandCancelled, match="the program cancelled it"):
        walk.result()
    assert realm["ann"].walk(x=0) == 0.0, "the robot is free"


def test_a_command_is_paused_stepped_and_continued(realm: Realm) -> None:
    ann = realm["ann"]
    with pytest.raises(NotPaused):
        realm.step("ann")
    realm.pause("ann")
    walk = ann.walk.start(x=1, steps=5)
    with pytest.raises(TimeoutError):
        walk.result(timeout=1.0)
    assert "sleep" in realm.step("ann")
    assert not walk.done
    realm.go_on("ann")
    assert walk.result(timeout=60) == pytest.approx(1.0)


def test_a_command_ends_with_the_block_that_has_started_it_and_a_told_one_goes_on(realm: Realm) -> None:
    with connect() as other:
        other["ann"].walk.start(x=1, steps=1000)
    assert realm["ann"].walk(x=0, within="5 s") == 0.0
    with connect() as other:
        other["ann"].walk.tell(x=5, steps=20)
    assert realm.describe("ann").busy == "walk"
    while realm.describe("ann").busy:
        time.sleep(0.02)
    assert realm["ann"].readings.x == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("signal_", "last"),
    [(signal.SIGKILL, []), (signal.SIGINT, ["KeyboardInterrupt"])],
    ids=["killed", "ctrl-c"],
)
def test_a_command_ends_with_the_program_however_that_ends(
    realm: Realm, signal_: signal.Signals, last: list[str]
) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", "import robotree\nrobotree.connect()['ann'].walk(x=1, steps=2000)"],
        stderr=subprocess.PIPE,
        text=True,
    )
    while realm.describe("ann").busy != "walk":
        time.sleep(0.02)
    program.send_signal(signal_)
    _, complaints = program.communicate(timeout=60)
    assert complaints.splitlines()[-1:] == last
    assert realm["ann"].walk(x=0, within="5 s") == 0.0


def test_robots_are_put_on_top_of_robots_and_taken_apart(realm: Realm, realm_of_processes: Path) -> None:
    leader = realm.create(str(realm_of_processes), "leader", wanted="Leader")
    realm.enslave("leader.walker", "ann")
    assert [robot.name for robot in realm.tree()] == ["leader", "ann"]
    assert leader.walk(x=4) == 4.0
    with pytest.raises(NotInControl):
        realm["ann"].walk(x=0)
    realm.release("leader.walker")
    assert realm["ann"].walk(x=0) == 0.0
    latest = time.monotonic() + SOON  # the lookup services hear of it a moment later
    while len(realm.ls()) < 2 and time.monotonic() < latest:
        time.sleep(0.01)
    assert sorted(robot.name for robot in realm.ls()) == ["ann", "leader"]
    assert realm.delete("leader") == ""
    brisk = realm.create(str(realm_of_processes), "brisk", wanted="Walker", stride="1.5 m")
    assert brisk.where().stride == 1.5
    assert realm.reload("brisk").notes is not None
    assert any("walk" in line.text for line in realm.log("ann"))


def test_a_stopped_robot_refuses_until_it_is_resumed(realm: Realm) -> None:
    assert realm.stop("ann") == ["ann"]
    with pytest.raises(Exception, match="stop"):
        realm["ann"].walk(x=1)
    assert realm.resume("ann") == ["ann"]
    assert realm["ann"].walk(x=1) == 1.0


def test_a_robot_of_a_kind_is_given_with_its_type(realm: Realm) -> None:
    ann = realm.get("ann", Walker)
    assert ann.walk(x=1) == 1.0
    assert str(realm.get("ann")) == "ann"
    with pytest.raises(NotThisKind, match="ann is no Swimmer: it is of kind Walker"):
        realm.get("ann", Swimmer)
    with pytest.raises(NoSuchRobot):
        realm.get("bob")


def test_readings_come_as_the_robot_publishes_them(realm: Realm) -> None:
    walk = realm["ann"].walk.start(x=3, steps=20)
    seen = [reading.x for reading, _ in zip(realm["ann"].readings(hz=20), range(4), strict=False)]
    assert len(seen) == 4
    assert seen == sorted(seen)
    assert seen[-1] > 0
    assert walk.result() == pytest.approx(3.0)
    assert realm["ann"].readings["x"] == pytest.approx(3.0)
    with pytest.raises(ValueError, match="rate above 0"):
        next(iter(realm["ann"].readings(hz=0)))


def test_readings_of_a_robot_that_is_deleted_end_with_an_error(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asynchronous, "SILENCE", 0.1)
    readings = realm["ann"].readings(hz=100)
    next(iter(readings))
    realm.delete("ann")
    with pytest.raises(NoSuchRobot):
        for _ in readings:
            pass


def test_a_watch_tells_which_robot_changed(realm: Realm) -> None:
    walk = realm["ann"].walk.start(x=1, steps=10)
    for name, state in realm.watch():
        if state.busy == "walk":
            assert name == "ann"
            break
    walk.result()


def test_a_realm_that_was_left_refuses(realm_of_processes: Path) -> None:
    realm = connect()
    realm.close()
    realm.close()
    with pytest.raises(TransportClosed):
        realm.tree()
    with pytest.raises(BadName):
        connect("no name")
    assert not [thread for thread in threading.enumerate() if thread.name == "robotree"]
    assert realm_of_processes.exists()


def test_a_forked_child_is_ended_with_a_sentence_and_its_parent_goes_on(realm: Realm) -> None:
    code = """
import os, robotree
with robotree.connect() as realm:
    ann = realm['ann']
    ann.where()
    if (child := os.fork()) == 0:
        ann.where()
    print(os.waitpid(child, 0)[1] != 0, ann.where().stride, repr(realm))
"""
    done = ran([sys.executable, "-c", code], within=60)
    assert done.stdout == "True 0.5 <realm default>\n", done.stderr
    assert "fork" in done.stderr
    assert realm["ann"].where().stride == 0.5


def test_several_threads_may_use_one_realm(realm: Realm) -> None:
    results: list[Any] = []
    threads = [threading.Thread(target=lambda: results.append(realm["ann"].where().stride)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [0.5] * 8


async def test_asyncio_has_the_same(realm_of_processes: Path) -> None:
    async with connect_async() as realm:
        ben = await realm.create(str(realm_of_processes), "ben", wanted="Walker")
        assert await ben.walk(2, within=60) == 2.0
        walk = await ben.walk.start(x=1, steps=20)
        async for reading in ben.readings(hz=50):
            if reading.x:  # what was published before may come first
                assert 1 <= reading.x <= 2
                break
        await walk.cancel()
        with pytest.raises(CommandCancelled):
            await walk
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.2):
                await ben.walk(x=9, steps=1000)
        assert (await ben.where()).x < 9
        assert await ben.walk(x=0, within=60) == 0.0, "what was waited for in vain has ended"
        await realm.delete("ben")


def test_a_name_that_is_missing_is_said_to_be() -> None:
    import robotree

    assert {"connect", "connect_async"} <= set(dir(robotree))
    with pytest.raises(AttributeError, match="has no attribute 'conect'"):
        _ = robotree.conect  # type: ignore[attr-defined] # a mistake of its author


@pytest.mark.speed
def test_the_import_takes_at_most_60_ms_more_than_python() -> None:
    def took(code: str) -> float:
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, env=os.environ)
        return time.perf_counter() - began

    least = [min(took(code) for _ in range(7)) for code in ("from robotree import connect", "import asyncio")]
    assert least[0] - least[1] < 0.06


# -- each program of docs/programs.md runs as it is written, at a simulated arm with its real proxy


PAGE = Path(__file__).parents[2] / "docs" / "programs.md"
EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)


@pytest.fixture(scope="module")
def arm(realm_of_processes: Path, shared_place: Path) -> Iterator[Path]:
    """A quick simulated arm and its proxy `arm-1`; gives a folder for programs."""
    del realm_of_processes  # lookup service and host
    folder = shared_place / "programs"  # beside the realms' folder, `robotree`, they would import that
    folder.mkdir()
    shutil.copy(EXAMPLES / "move_to.py", folder)
    simulation = ("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--speedup", "6", "--open")
    with (
        member(*simulation) as address,
        member("proxy", "arm", "arm-1", "--connect", address, "--open"),
    ):
        yield folder


@pytest.mark.parametrize("number", range(len(PROGRAMS)))
def test_a_program_of_the_page_runs(arm: Path, number: int) -> None:
    text = PROGRAMS[number]
    if "async def main" in text:
        text += "\n\nimport asyncio\n\nasyncio.run(main())\n"
    program = arm / f"test_program_{number}.py"
    program.write_text(text)
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider"] if "def test_" in text else []
    done = ran([sys.executable, *words, str(program)], cwd=arm)
    assert done.returncode == 0, done.stdout + done.stderr
    if "could not" in text:  # each branch of the example is taken
        assert "refused before anything moved: " in done.stdout
        assert "the robot could not: " in done.stdout


def test_the_page_has_programs() -> None:
    assert len(PROGRAMS) == 6
