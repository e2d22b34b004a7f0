"""A stop among real processes of which one hangs: it reaches all others, and nobody calls it complete."""

from __future__ import annotations

import asyncio
import itertools
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.line import manual, verbs
from robotree.tui.line.carrying import Silent
from robotree.vr.base.errors import Hanging, NoSuchRobot, NotConfirmed, Stopped
from robotree.vr.network import lean_stop
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.vr.network.processes import Start, remove
from tests.withheld import Withheld

Look = Callable[[], Awaitable[RealmClient]]


@pytest.fixture
async def look(join_realm: Callable[[], Awaitable[LocalTransport]]) -> AsyncIterator[Look]:
    """Return a way to come into the realm and look around."""
    realm_clients: list[RealmClient] = []

    async def come() -> RealmClient:
        realm_clients.append(RealmClient(await join_realm()))
        await realm_clients[-1].start()
        return realm_clients[-1]

    yield come
    for realm_client in realm_clients:
        await realm_client.close()


WITHOUT_A_NAME = """
import os, signal, socket, sys
door = socket.socket(socket.AF_UNIX)
door.bind(f"{sys.argv[1]}/.{os.getpid()}-0123abcd")
door.listen()
os.kill(os.getpid(), signal.SIGSTOP)
"""
"""What a newcomer has done that is stopped just before it gives its socket the name by which it is found."""

AT_ONCE = 1.0
"""[s] in which a person knows which robots a stop may have missed."""


class Newcomer:
    """Comes to a realm to stop all, as `robotree stop` does: it looks around for nobody before."""

    def __init__(self, place: Path) -> None:
        self._root = place / "robotree"
        self.late: list[str] = []
        self.took = 0.0

    async def stop(self, name: str | None = None) -> list[str]:
        withheld, began = Withheld(os.getpid()), time.monotonic()
        transport = await join("test", root=self._root, greeting=0)
        try:
            return sorted(await RealmClient(transport).stop(name, on_late=self.late.append))
        finally:
            self.took = time.monotonic() - began - withheld.seconds
            await transport.close()


@pytest.fixture
def newcomer(place: Path) -> Newcomer:
    return Newcomer(place)


async def robots(start: Start, *names: str) -> list[Any]:
    members = [await start("robot", name) for name in names]
    await asyncio.gather(*(member.ready() for member in members))
    return members


def hangs(name: str, member: Any) -> str:
    pid = member.process.pid
    return (
        rf"but NOT by {name} \(in process {pid}, which hangs\); press the emergency stop of whatever they "
        rf"drive, then: `kill -CONT {pid}` wakes it, `kill -9 {pid}` ends it$"
    )


@pytest.mark.speed
async def test_who_comes_after_a_process_froze_knows_whom_its_stop_did_not_reach(
    start: Start, look: Look
) -> None:
    _, frozen = await robots(start, "awake", "frozen")
    await frozen.freeze()
    realm_client = await look()
    began = time.monotonic()
    with pytest.raises(
        NotConfirmed, match=r"^the protective stop is confirmed by awake " + hangs("frozen", frozen)
    ):
        await realm_client.stop(None)
    assert time.monotonic() - began < 6
    with pytest.raises(Stopped):
        await realm_client.call("awake", "move", {"x": 1.0})
    with pytest.raises(NotConfirmed, match="confirmed by nobody " + hangs("frozen", frozen)):
        await realm_client.stop("frozen")
    with pytest.raises(NoSuchRobot):
        await realm_client.stop("nobody")
    frozen.signal(signal.SIGCONT)
    assert list(await realm_client.stop(None)) == ["awake", "frozen"]


@pytest.mark.parametrize("known", [False, True], ids=["by a newcomer", "by one that knew it before"])
async def test_a_robot_that_was_frozen_when_all_were_stopped_stops_when_it_wakes(
    start: Start, look: Look, newcomer: Newcomer, *, known: bool
) -> None:
    """The order waits in the socket of its process, also when the one who gave it has ended."""
    _, frozen = await robots(start, "awake", "frozen")
    realm_client = await look()
    await until(lambda: len(realm_client.directory.present("robot")) == 2, "both are seen")
    await frozen.freeze()
    await until(lambda: len(realm_client.directory.present("robot")) == 1, "its presence is over")
    with pytest.raises(NotConfirmed):
        await (realm_client.stop(None) if known else newcomer.stop())
    frozen.signal(signal.SIGCONT)
    await until(lambda: len(realm_client.directory.present("robot")) == 2, "it is seen again")
    while not (await realm_client.describe("frozen")).stopped:  # noqa: ASYNC110 # it reads the order as it wakes
        await asyncio.sleep(0.001)
    with pytest.raises(Stopped):
        await realm_client.call("frozen", "move", {"x": 1.0})
    assert list(await realm_client.resume(None)) == ["awake", "frozen"]
    assert await realm_client.call("frozen", "move", {"x": 1.0}) == 1.0


@pytest.mark.parametrize("name", [None, "frozen"], ids=["all are stopped", "it is stopped by name"])
@pytest.mark.parametrize("lean", [False, True], ids=["by a full order", "by what is sent before it"])
async def test_a_frozen_robot_whose_list_is_damaged_stops_when_it_wakes(
    start: Start, look: Look, newcomer: Newcomer, place: Path, name: str | None, *, lean: bool
) -> None:
    """Nobody can read which robots its process has, so the process is asked for all that are meant."""
    _, frozen = await robots(start, "awake", "frozen")
    await frozen.freeze()
    (held,) = (place / "robotree" / "test").glob(f"{frozen.process.pid}-*.held")
    held.write_bytes(b"\0garbage\n")
    if lean:
        assert lean_stop.send_first(["stop", "--realm", "test", *([name] if name else [])])
    else:
        with pytest.raises(NotConfirmed, match=f"process {frozen.process.pid} .*gone or damaged"):
            await newcomer.stop(name)
    frozen.signal(signal.SIGCONT)
    realm_client = await look()
    await until(lambda: len(realm_client.directory.present("robot")) == 2, "it is seen again")
    async with asyncio.timeout(60):
        while not (await realm_client.describe("frozen")).stopped:  # noqa: ASYNC110 # it reads the order as it wakes
            await asyncio.sleep(0.001)
    assert (await realm_client.describe("awake")).stopped == (name is None), (
        "the other one only if it was meant"
    )


async def test_whoever_comes_after_a_stop_ends_it_at_once(start: Start, look: Look) -> None:
    await robots(start, "one", "other")
    first = await look()
    assert list(await first.stop(None)) == ["one", "other"]
    second = await look()
    assert list(await second.resume("one")) == ["one"]
    with pytest.raises(Stopped):
        await first.call("other", "move", {"x": 1.0})
    assert list(await first.resume(None)) == ["one", "other"]
    assert await second.call("other", "move", {"x": 1.0}) == 1.0


async def test_who_was_there_before_a_process_froze_knows_it_too(start: Start, look: Look) -> None:
    _, frozen = await robots(start, "awake", "frozen")
    realm_client = await look()
    await until(lambda: len(realm_client.directory.present("robot")) == 2, "both are seen")
    await frozen.freeze()
    with pytest.raises(NotConfirmed, match="confirmed by awake " + hangs("frozen", frozen)):
        await realm_client.stop(None)
    await until(lambda: len(realm_client.directory.present("robot")) == 1, "its presence is over")
    with pytest.raises(NotConfirmed, match="confirmed by awake " + hangs("frozen", frozen)):
        await realm_client.stop(None)
    frozen.signal(signal.SIGKILL)
    await frozen.process.wait()
    assert not await realm_client.hanging()
    assert list(await realm_client.stop(None)) == ["awake"], "the dead hold nothing"


async def test_a_frozen_process_that_holds_no_robot_spoils_no_stop(start: Start, look: Look) -> None:
    await robots(start, "awake")
    lookup = await start("lookup", "l1")
    await lookup.ready()
    lookup.signal(signal.SIGSTOP)
    realm_client = await look()
    assert list(await realm_client.stop(None)) == ["awake"]
    lookup.signal(signal.SIGCONT)


async def test_whatever_is_asked_of_a_frozen_robot_its_process_is_named(start: Start, look: Look) -> None:
    _, frozen = await robots(start, "awake", "frozen")
    watcher = await look()
    await until(lambda: len(watcher.directory.present("robot")) == 2, "both are seen")
    pid = frozen.process.pid
    who = (
        rf"^the robot 'frozen' is in process {pid}, which hangs and does not answer; "
        rf"`kill -CONT {pid}` wakes it, `kill -9 {pid}` ends it$"
    )
    await frozen.freeze()
    with pytest.raises(Hanging, match=who):  # its presence stands, until it is asked
        await watcher.describe("frozen")
    newcomer = await look()
    for realm_client in (watcher, newcomer):
        questions: list[Awaitable[object]] = [
            realm_client.describe("frozen"),
            realm_client.call("frozen", "move", {"x": 1.0}),
            realm_client.cancel("frozen"),
            realm_client.release("frozen", "slot"),
            realm_client.delete("frozen"),
            realm_client.enslave("awake", "slot", "frozen"),
        ]
        for question in questions:
            with pytest.raises(Hanging, match=who):
                await question
    frozen.signal(signal.SIGCONT)
    await until(lambda: len(newcomer.directory.present("robot")) == 2, "it is seen again")
    assert (await newcomer.describe("frozen")).name == "frozen"
    frozen.signal(signal.SIGKILL)
    await frozen.process.wait()
    await until(lambda: len(newcomer.directory.present("robot")) == 1, "it is missed")
    with pytest.raises(NoSuchRobot):
        await newcomer.describe("frozen")


LEVEL = """
from robotree.vr import Child, VirtualRobot

class Level(VirtualRobot):
    below = Child("Robot")
"""


@pytest.mark.speed
async def test_of_thirty_levels_in_four_processes_ten_of_ten_stops_are_told_truly(
    start: Start, look: Look, tmp_path: Path
) -> None:
    hosts = [await start("host", f"h{number}") for number in range(3)]
    await asyncio.gather(*(host.ready() for host in hosts), robots(start, "rover"))
    realm_client = await look()
    (tmp_path / "level.py").write_text(LEVEL)
    names = [f"level-{number}" for number in range(30)]
    source = str(tmp_path / "level.py")
    for number in range(0, 30, 3):  # neighbours live in different processes
        await asyncio.gather(
            *(
                realm_client.create(source, name, f"h{at}")
                for at, name in enumerate(names[number : number + 3])
            )
        )
    await until(lambda: len(realm_client.directory.present("robot")) == 31, "all are seen")
    for parent, child in reversed(list(itertools.pairwise([*names, "rover"]))):
        await realm_client.enslave(parent, "below", child)
    for name in ("level-0", None):
        for _ in range(10):
            assert sorted(await realm_client.stop(name)) == sorted([*names, "rover"])
            assert sorted(await realm_client.resume(name)) == sorted([*names, "rover"])


async def test_a_newcomer_says_at_once_whom_its_stop_did_not_reach(start: Start, newcomer: Newcomer) -> None:
    _, frozen = await robots(start, "awake", "frozen")
    lookup = await start("lookup", "l1")
    await lookup.ready()
    for process in (frozen, lookup):  # nobody is waited for who could say who is there
        await process.freeze()
    with pytest.raises(NotConfirmed, match=r"confirmed by awake " + hangs("frozen", frozen)):
        await newcomer.stop()
    assert newcomer.took < AT_ONCE
    (late,) = newcomer.late
    assert late.endswith(f"without an answer yet from frozen (in process {frozen.process.pid}, which hangs)")
    frozen.signal(signal.SIGCONT)
    assert await newcomer.stop() == ["awake", "frozen"]
    assert await newcomer.stop("frozen") == ["frozen"]
    assert newcomer.took < AT_ONCE
    lookup.signal(signal.SIGCONT)


async def test_nobody_is_told_to_end_by_force_a_process_that_only_is_not_heard(
    start: Start, newcomer: Newcomer
) -> None:
    """It may answer others: only of a process that is stopped it is certain that it does not."""
    deaf = await start("deaf", "deaf")
    await deaf.ready()
    pid = deaf.process.pid
    with pytest.raises(NotConfirmed) as caught:
        await newcomer.stop()
    assert f"NOT by deaf (in process {pid}, which runs and could not be reached" in str(caught.value)
    assert f"`kill {pid}` ends it" in str(caught.value)
    assert "kill -9" not in str(caught.value)
    assert len(newcomer.late) == 1


async def test_a_stop_knows_of_a_process_that_nobody_can_find(start: Start, newcomer: Newcomer) -> None:
    await robots(start, "awake")
    folder = Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / "test"
    nameless = await asyncio.create_subprocess_exec(sys.executable, "-c", WITHOUT_A_NAME, str(folder))
    while not list(folder.glob(f".{nameless.pid}-*")):  # noqa: ASYNC110 # what is seen of it is the condition
        await asyncio.sleep(0.01)
    try:
        with pytest.raises(
            NotConfirmed,
            match=rf"by awake but NOT by process {nameless.pid} \(its files in the realm's folder are gone",
        ):
            await newcomer.stop()
        assert newcomer.took < AT_ONCE
        assert await newcomer.stop("awake") == ["awake"], "it is not the one that was meant"
    finally:
        nameless.kill()
        await nameless.wait()
    assert await newcomer.stop() == ["awake"]


@pytest.mark.parametrize("left", [0, 12, 20, 25, -1])
async def test_a_stop_and_ls_name_a_frozen_process_whose_list_was_cut(
    start: Start, newcomer: Newcomer, look: Look, left: int
) -> None:
    """To nothing, in its seal, behind it, in its only line, before its last line end."""
    _, frozen = await robots(start, "awake", "frozen")
    lookup = await start("lookup", "l1")
    await lookup.ready()
    await frozen.freeze()
    pid = frozen.process.pid
    folder = Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / "test"
    (path,) = folder.glob(f"{pid}-*.held")
    os.truncate(path, left % path.stat().st_size)
    with pytest.raises(NotConfirmed, match=rf"by awake but NOT by process {pid} \(its files"):
        await newcomer.stop()
    listed = await verbs.ls(await look(), manual.shell().parse(["ls"]), Silent())
    assert f"any robot of process {pid} hangs in process {pid}: `kill -CONT {pid}`" in str(listed.doubt)
    assert any(line.startswith(f"any robot of process {pid} ") for line in listed.text.splitlines())
    frozen.signal(signal.SIGCONT)
    assert await newcomer.stop() == ["awake", "frozen"]


async def test_a_stop_reaches_all_whose_folder_was_removed_just_now(start: Start, newcomer: Newcomer) -> None:
    _, frozen = await robots(start, "awake", "frozen")
    folder = Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / "test"
    remove(folder)
    assert await newcomer.stop() == ["awake", "frozen"]
    await frozen.freeze()
    remove(folder)
    pid = frozen.process.pid  # under load it may have gone on for a moment, and have taken a name again
    who = (
        rf"(process {pid} \(its files in the realm's folder are gone|frozen \(in process {pid}, which hangs)"
    )
    with pytest.raises(NotConfirmed, match=rf"by awake but NOT by {who}"):
        await newcomer.stop()
    assert newcomer.took < AT_ONCE
    frozen.signal(signal.SIGCONT)
    assert await newcomer.stop() == ["awake", "frozen"]
