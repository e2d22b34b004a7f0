"""A stop among real processes of which one hangs: it reaches all others, and nobody calls it complete."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.line import manual, verbs
from robotree.tui.line.carrying import Silent
from robotree.vr.base.errors import NotConfirmed, Stopped
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.vr.network.processes import Start
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


async def stops_as_it_wakes(realm_client: RealmClient) -> None:
    """The order waited in the socket of its process, although the one who gave it has ended."""
    await until(lambda: len(realm_client.directory.present("robot")) == 2, "it is seen again")
    while not (await realm_client.describe("frozen")).stopped:  # noqa: ASYNC110 # it reads the order as it wakes
        await asyncio.sleep(0.001)
    with pytest.raises(Stopped):
        await realm_client.call("frozen", "move", {"x": 1.0})


async def test_a_newcomer_says_at_once_whom_its_stop_did_not_reach_and_who_wakes_stops(
    start: Start, newcomer: Newcomer, look: Look
) -> None:
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
    for process in (frozen, lookup):
        process.signal(signal.SIGCONT)
    realm_client = await look()
    await stops_as_it_wakes(realm_client)
    assert list(await realm_client.resume(None)) == ["awake", "frozen"]
    assert await realm_client.call("frozen", "move", {"x": 1.0}) == 1.0
    assert await newcomer.stop() == ["awake", "frozen"]
    assert await newcomer.stop("frozen") == ["frozen"]
    assert newcomer.took < AT_ONCE


async def test_a_stop_and_ls_name_a_frozen_process_whose_list_was_cut_and_it_stops_when_it_wakes(
    start: Start, newcomer: Newcomer, look: Look
) -> None:
    """Nobody can read which robots its process has, so the process is asked for the one that is meant."""
    _, frozen = await robots(start, "awake", "frozen")
    lookup = await start("lookup", "l1")
    await lookup.ready()
    await frozen.freeze()
    pid = frozen.process.pid
    folder = Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / "test"
    (path,) = folder.glob(f"{pid}-*.held")
    os.truncate(path, 12)
    with pytest.raises(NotConfirmed, match=rf"NOT by process {pid} \(its files .*gone or damaged"):
        await newcomer.stop("frozen")
    realm_client = await look()
    listed = await verbs.ls(realm_client, manual.shell().parse(["ls"]), Silent())
    assert f"any robot of process {pid} hangs in process {pid}: `kill -CONT {pid}`" in str(listed.doubt)
    assert any(line.startswith(f"any robot of process {pid} ") for line in listed.text.splitlines())
    frozen.signal(signal.SIGCONT)
    await stops_as_it_wakes(realm_client)
    assert not (await realm_client.describe("awake")).stopped, "the other one was not meant"
    assert await newcomer.stop() == ["awake", "frozen"]
