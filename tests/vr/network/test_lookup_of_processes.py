"""Lookup, robots and hosts as real processes over real Zenoh: killed, stopped, and back."""

from __future__ import annotations

import signal
from collections.abc import AsyncIterator, Awaitable, Callable

import pytest

from robotree.vr.network.local import LocalTransport
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import patience, until
from tests.vr.network.processes import Start, start_all


class Onlooker:
    """A realm_client, and what it was told."""

    def __init__(self, realm_client: RealmClient) -> None:
        self.realm_client = realm_client
        self.told: list[str] = []
        realm_client.directory.on_change(
            lambda change: (
                self.told.append(f"{change.kind} {change.listing.name}") if change.listing else None
            )
        )

    @property
    def names(self) -> list[str]:
        return [listing.name for listing in self.realm_client.robots()]


@pytest.fixture
async def onlooker(join_realm: Callable[[], Awaitable[LocalTransport]]) -> AsyncIterator[Onlooker]:
    realm_client = RealmClient(await join_realm())
    onlooker = Onlooker(realm_client)
    await realm_client.start()
    yield onlooker
    await realm_client.close()


async def test_lookups_are_killed_and_stopped_and_nobody_notices(start: Start, onlooker: Onlooker) -> None:
    *lookups, rover = await start_all(
        start, ("lookup", "l1"), ("lookup", "l2"), ("lookup", "l3"), ("robot", "rover")
    )
    realm_client = onlooker.realm_client
    await until(lambda: onlooker.told == ["arrived rover"], "a robot is listed, once")
    await until(lambda: list(realm_client.services) == ["l1", "l2", "l3"], "all three are there")
    lookups[0].signal(signal.SIGKILL)
    lookups[1].signal(signal.SIGSTOP)
    assert await realm_client.call("rover", "move", {"x": 1.0}) == 1.0
    await until(lambda: list(realm_client.services) == ["l3"], "only one is left")
    lookups[1].signal(signal.SIGCONT)
    await until(lambda: list(realm_client.services) == ["l2", "l3"], "the stopped one is back")
    await realm_client.directory.settled(patience())
    await until(lambda: not realm_client.directory.remembers, "what the lost ones said is forgotten")
    assert onlooker.told == ["arrived rover"]
    for lookup in lookups[1:]:
        lookup.signal(signal.SIGKILL)
    await until(lambda: realm_client.stale, "all are gone")
    assert await realm_client.call("rover", "move", {"x": 2.0}) == 2.0, "robots obey those who know them"
    assert onlooker.names == ["rover"]
    await start_all(start, ("lookup", "l4"))
    await until(lambda: list(realm_client.services) == ["l4"], "a new one is there")
    await until(lambda: not realm_client.directory.remembers, "what the lost ones said is forgotten")
    assert onlooker.told == ["arrived rover"], "all have registered again before the old list was forgotten"
    rover.signal(signal.SIGKILL)
    await until(lambda: onlooker.told[1:] == ["departed rover"], "a death is noticed")


async def test_members_end_in_order_when_their_tether_is_cut(start: Start, onlooker: Onlooker) -> None:
    members = await start_all(start, ("lookup", "l1"), ("host", "h1"), ("robot", "rover"))
    await until(lambda: onlooker.names == ["rover"], "the rover is listed")
    for member in members:
        assert await member.end() == (0, "")
    await until(lambda: onlooker.realm_client.stale and onlooker.names == [], "all have left")
    assert await onlooker.realm_client.hosts() == []
