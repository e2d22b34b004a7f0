"""A desk and a plant with a line between them that delays, loses, carries little, and is cut: one story."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.sites.slow_line import SlowLine
from tests.command_line import ROBOTREE
from tests.plant import Machine
from tests.ports import free_port
from tests.terminal import ENTER, Person
from tests.waiting import wait_until

pytestmark = [pytest.mark.story, pytest.mark.soak]  # minutes, over a slow line

EXAMPLES = Path(__file__).parents[2] / "examples"


class Line:
    """A slow line on an event loop of its own."""

    def __init__(self, port: int) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._line = SlowLine("127.0.0.1", port)
        self.port: int = asyncio.run_coroutine_threadsafe(self._line.open(), self._loop).result(60)

    def be(self, *, delay: float = 0.0, rate: float = 0.0, loss: float = 0.0) -> None:
        """Be slow from now on: [s] one way, [bit/s], share of segments."""
        self._line.delay, self._line.rate, self._line.loss = delay, rate, loss

    def cut(self) -> None:
        self._loop.call_soon_threadsafe(self._line.cut)

    def mend(self) -> None:
        self._loop.call_soon_threadsafe(self._line.mend)

    def close(self) -> None:
        asyncio.run_coroutine_threadsafe(self._line.close(), self._loop).result(60)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(60)
        self._loop.close()


class Far:
    """A hub at the desk; the plant, with a rover and its view, reaches it by the line."""

    def __init__(self, folder: Path) -> None:
        self.hub, self.desk, self.plant = (Machine(folder, name) for name in ("hub", "desk", "plant"))
        port, rover = free_port(), free_port()
        address = self.hub.start("hub", "hub", "--listen", f"tls:127.0.0.1:{port}")
        self.line = Line(port)
        by_line = f"tls:127.0.0.1:{self.line.port}#{address.partition('#')[2]}"
        self.desk.say("realm", "create", "plant", "--hub", by_line, "--site", "desk")
        token = self.desk.say("realm", "invite", "plant")["token"]
        self.desk.start("gateway", "gateway")
        self.plant.say("realm", "join", token)
        self.plant.start("gateway", "gateway")
        self.desk.start("lookup", "lookup", "lookup-1")
        self.plant.start("lookup", "lookup", "lookup-2")
        self.desk.start("host", "host", "host-1")
        self.plant.start("sim", "sim", "rover", "--listen", f"tcp:127.0.0.1:{rover}", "--open")
        self.plant.start("view", "view", "cell", "--connect", f"tcp:127.0.0.1:{rover}", "--open")
        self.plant.start("proxy", "proxy", "rover", "r1", "--connect", f"tcp:127.0.0.1:{rover}", "--open")
        self.linked()

    def linked(self) -> None:
        """Wait until the desk has an answer from the plant."""
        wait_until(lambda: self.desk.text("show", "r1"), "the plant is linked")

    def close(self) -> None:
        self.line.mend()
        for machine in (self.desk, self.plant, self.hub):
            for called in list(machine.running):
                machine.end(called)
        self.line.close()


@pytest.fixture(scope="module")
def far() -> Iterator[Far]:
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        found = Far(Path(folder))
        try:
            yield found
        finally:
            found.close()


@pytest.mark.e2e
@pytest.mark.timeout(900)
def test_verbs_and_screen_are_of_use_at_600_ms_there_and_back_and_each_row_says_how_old_it_is(
    far: Far, monkeypatch: pytest.MonkeyPatch
) -> None:
    far.line.be(delay=0.15)  # the hub is in the middle: each message to the plant takes the line twice
    desk = far.desk
    wait_until(lambda: placed(row_of(desk, "r1")), "its row says where it is, and that the way is long")
    wait_until(lambda: re.search(r"r1 .* plant, \d+\.\d s ago", desk.text("ls")), "people read it, too")
    done(desk, "call", "r1.move", "x=0.02", "y=0")
    done(desk, "create", str(EXAMPLES / "move_square.py"), "as", "square")
    bound(far)
    done(desk, "call", "square.move_square", "length=0.02m")
    wait_until(lambda: "s to r1 and back; its lease bears" in desk.text("show", "square"), "it is measured")
    wait_until(lambda: bears(asked(desk, "show", "square")), "and it is the delay of the line, or more")
    for variable, value in desk.environment.items():
        monkeypatch.setenv(variable, value)
    person = Person("plant")
    try:
        person.shows(b"r1")
        person.shows(*(b"plant %g s" % (half / 2) for half in range(1, 20)))
        person.types(f":stop{ENTER}", sees="stopped")
    finally:
        person.leave()
    wait_until(lambda: plant_of(far).get("stopped"), "and there it is so")
    done(desk, "resume")
    assert not plant_of(far).get("stopped")


@pytest.mark.e2e
@pytest.mark.timeout(900)
def test_a_motion_whose_commander_is_cut_off_ends_with_its_lease(far: Far) -> None:
    far.line.be(delay=0.02)
    bound(far)
    with moving(far):
        cut = time.time()
        far.line.cut()
        wait_until(lambda: is_free(plant_of(far)), "its lease ends by itself, and its motion with it")
        wait_until(lambda: last_end(far.plant).get("unix", 0.0) > cut, "it is kept that it has ended")
        assert last_end(far.plant)["error"], "it has not arrived"
    done(far.desk, "call", "r1.move", "x=0.02", "y=0")


@contextmanager
def moving(far: Far) -> Iterator[None]:
    """Have the robot of the desk move the one of the plant for a while; at the end the line is whole."""
    words = [*ROBOTREE, "call", "square.move", "x=-1", "y=0", "speed=0.02"]  # for 50 s
    running = list[subprocess.Popen[bytes]]()

    def moves() -> bool:
        if not running or running[-1].poll() is not None:  # a busy machine may have refused it
            running.append(subprocess.Popen(words, stderr=subprocess.DEVNULL, env=far.desk.environment))
        return plant_of(far).get("busy") == "move"

    wait_until(moves, "it moves")
    try:
        yield
    finally:
        far.line.mend()
        for one in running:
            one.wait(120)
    assert running[-1].returncode != 0


def asked(machine: Machine, *words: str) -> dict[str, Any]:
    """What a machine answers, as plain data; a machine that is busy may have no answer."""
    return json.loads(machine.text(*words, "--json").strip() or "{}")


def bears(robot: dict[str, Any]) -> bool:
    """Whether the lease on a child bears less than its term, beside a way as long as the line."""
    slot = (robot.get("slots") or [{}])[0]
    return slot.get("way", 0.0) >= 0.5 and 0 <= slot.get("bears", 0.0) < 5


def is_free(robot: dict[str, Any]) -> bool:
    return "address" in robot and robot.get("bond") is None and not robot.get("busy")


def placed(row: dict[str, Any]) -> bool:
    return row.get("site") == "plant" and row["age"] >= 0.25


def done(machine: Machine, *words: str) -> None:
    """Say a line until it is done: on a busy machine the other site may be silent for a moment."""
    wait_until(lambda: machine.text(*words), " ".join(words))


def bound(far: Far) -> None:
    """Have the robot of the desk command the one of the plant."""
    enslave = ("enslave", "square.rover", "r1")
    wait_until(lambda: plant_of(far).get("bond") or far.desk.text(*enslave), "it is enslaved")


def last_end(machine: Machine) -> dict[str, Any]:
    """What is kept of the latest command of the robot that has ended."""
    kept = json.loads(machine.text("history", "r1", "--json").strip() or "[]")
    return next((one for one in reversed(kept) if one["kind"] == "ended"), {})


def plant_of(far: Far) -> dict[str, Any]:
    return asked(far.plant, "show", "r1")


def row_of(machine: Machine, name: str) -> dict[str, Any]:
    """The row of a robot in the list; a machine that is busy may not have heard of everybody yet."""
    said = machine.text("ls", "--json").strip()
    return next((row for row in json.loads(said or "[]") if row["address"]["name"] == name), {})
