"""A desk and a plant with a line between them that delays, loses, carries little, and is cut: one story."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import tempfile
import threading
import time
from collections.abc import AsyncGenerator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.sites.slow_line import SlowLine
from robotree.vr.base.errors import VrError
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient
from tests.command_line import ROBOTREE
from tests.laboratory.laboratory import PAGES
from tests.plant import Machine
from tests.ports import free_port
from tests.terminal import ENTER, Person
from tests.waiting import until, wait_until

pytestmark = pytest.mark.story

EXAMPLES = Path(__file__).parents[2] / "examples"
CROWD = 100
"""Robots that are stopped."""


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
def test_verbs_and_screen_are_of_use_at_600_ms_there_and_back_and_each_row_says_how_old_it_is(
    far: Far, monkeypatch: pytest.MonkeyPatch
) -> None:
    far.line.be(delay=0.15)  # the hub is in the middle: each message to the plant takes the line twice
    desk = far.desk
    wait_until(lambda: row_of(desk, "r1").get("age", 0.0) >= 0.25, "the way is known to be long")
    assert row_of(desk, "r1")["site"] == "plant"
    wait_until(lambda: re.search(r"r1 .* plant, \d+\.\d s ago", desk.text("ls")), "people read it, too")
    desk.say("call", "r1.move", "x=0.02", "y=0")
    desk.say("create", str(EXAMPLES / "move_square.py"), "as", "square")
    desk.say("enslave", "square.rover", "r1")
    desk.say("call", "square.move_square", "length=0.02m")
    wait_until(lambda: "s to r1 and back; its lease bears" in desk.text("show", "square"), "it is measured")
    (slot,) = desk.say("show", "square")["slots"]
    assert slot["way"] >= 0.5
    assert 0 < slot["bears"] < 5 - slot["way"]
    for variable, value in desk.environment.items():
        monkeypatch.setenv(variable, value)
    person = Person("plant")
    try:
        person.shows(b"r1")
        person.shows(b"plant 0.5 s", b"plant 1 s", b"plant 1.5 s", b"plant 2 s")
        person.types(f":stop{ENTER}", sees="stopped")
    finally:
        person.leave()
    assert plant_of(far)["stopped"]
    wait_until(lambda: desk.text("resume"), "it is resumed")
    wait_until(lambda: not plant_of(far).get("stopped"), "there, too")


@pytest.mark.e2e
def test_a_motion_whose_commander_is_cut_off_ends_with_its_lease(far: Far) -> None:
    desk, plant = far.desk, far.plant
    far.line.be(delay=0.02)
    if plant_of(far).get("bond") is None:  # a busy machine may have cost it
        desk.say("enslave", "square.rover", "r1")
    calling = subprocess.Popen(
        [*ROBOTREE, "call", "square.move", "x=-1", "y=0", "speed=0.02"],  # for 50 s
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=desk.environment,
    )
    try:
        wait_until(lambda: plant_of(far).get("busy") == "move" or calling.poll() is not None, "it moves")
        assert calling.poll() is None, calling.communicate()
        cut = time.time()
        far.line.cut()
        wait_until(lambda: plant_of(far).get("bond") is None, "its lease ends by itself")
        wait_until(lambda: not plant_of(far).get("busy"), "and its motion with it")
        ended = [one for one in plant.say("history", "r1") if one["kind"] == "ended"][-1]
        assert ended["unix"] > cut
        assert ended["error"], "it has not arrived"
    finally:
        far.line.mend()
        calling.communicate(timeout=120)
    assert calling.returncode != 0
    far.linked()
    desk.say("call", "r1.move", "x=0.02", "y=0")


def plant_of(far: Far) -> dict[str, Any]:
    return far.plant.say("show", "r1")


def row_of(machine: Machine, name: str) -> dict[str, Any]:
    """The row of a robot in the list; a machine that is busy may not have heard of everybody yet."""
    said = machine.text("ls", "--json").strip()
    return next((row for row in json.loads(said or "[]") if row["address"]["name"] == name), {})


@pytest.mark.e2e
@pytest.mark.speed
@pytest.mark.timeout(600)
def test_pictures_go_at_the_rate_of_the_line_and_a_stop_of_a_hundred_robots_passes_them_within_a_second(
    far: Far,
) -> None:
    far.plant.start("host", "host", "host-2")
    took, pictures, rate = asyncio.run(flooded(far, 64_000.0, 0.03))
    assert took < 1.0, (took, pictures, rate)
    assert 64_000 / 4 < rate < 64_000, "pictures are neither starved nor more than the line carries"


async def flooded(far: Far, rate: float, loss: float) -> tuple[float, int, float]:
    """Have pictures flood the line; return how long a stop took [s], how many came, and at [bit/s]."""
    async with beside(far.plant) as there:
        for number in range(CROWD):
            await there.create(str(PAGES), f"leaf-{number}", "host-2", "Leaf")
    async with beside(far.desk) as here:
        await until(lambda: len(here.present("robot")) > CROWD, "all are seen")
        far.line.be(delay=0.02, rate=rate, loss=loss)
        sizes, over = list[int](), asyncio.Event()

        async def look() -> None:
            while not over.is_set():
                try:
                    sizes.append(len((await here.look("cell")).jpeg))
                except VrError:
                    await asyncio.sleep(0.1)

        looking = [asyncio.ensure_future(look()) for _ in range(5)]
        began = time.monotonic()
        await until(lambda: len(sizes) >= 5, "the line is full of pictures")
        ordered = time.monotonic()
        stopped = await here.stop(None)
        took = time.monotonic() - ordered
        assert len([one for one in stopped if "leaf-" in one]) == CROWD, stopped
        shown, seconds = list(sizes), time.monotonic() - began
        over.set()
        far.line.be()
        await asyncio.gather(*looking)
        return took, len(shown), sum(shown) * 8 / seconds


@asynccontextmanager
async def beside(machine: Machine) -> AsyncGenerator[RealmClient]:
    """Join the realm at a machine."""
    transport = await join("plant", root=Path(machine.environment["XDG_RUNTIME_DIR"]) / "robotree")
    client = RealmClient(transport, "plant")
    try:
        await client.start()
        yield client
    finally:
        await client.close()
        await transport.close()
