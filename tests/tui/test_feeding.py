"""The feed keeps a store up to date from a real realm client."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace

from robotree.tui.seen.feeding import Feed
from robotree.tui.seen.store import Store
from robotree.vr.base.errors import VrError
from robotree.vr.world.testing import until

if TYPE_CHECKING:
    from tui.conftest import Realm


async def test_lists_states_tree_and_hosts_come_by_themselves(realm: Realm) -> None:
    store = Store()
    feed = Feed(realm.realm_client, store, time.monotonic)
    await feed.open()
    assert set(store.robots) == {"arm-1", "rover-1"}, "the lists are there at once"
    await until(lambda: store.hosts == ("host-1",), "the hosts")
    await until(lambda: "x" in store.readings("arm-1"), "a state")
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    await until(lambda: store.lineage("arm-1") == ("arm-1", "mover"), "the tree")
    await until(lambda: "arm-1" not in store.robots, "it is enslaved")
    await feed.close()
    await feed.close()


async def test_who_comes_while_the_feed_begins_is_listed(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, watch_log = Store(), realm.realm_client.watch_log

    async def slow(*watched: Any) -> object:
        await realm.create("move_to.py", "mover")
        await until(lambda: "mover" in {robot.name for robot in realm.realm_client.robots()}, "it is known")
        return await watch_log(*watched)

    monkeypatch.setattr(realm.realm_client, "watch_log", slow)
    feed = Feed(realm.realm_client, store, time.monotonic)
    await feed.open()
    assert "mover" in store.robots
    await feed.close()


async def test_a_look_that_fails_is_told_and_the_next_one_heals(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store()
    feed = Feed(realm.realm_client, store, time.monotonic)
    looks = 0
    tree = realm.realm_client.tree

    async def fails_twice() -> object:
        nonlocal looks
        looks += 1
        if looks == 1:
            raise VrError(detail="the network is away")
        if looks == 2:
            raise RuntimeError("a mistake of ours")
        return await tree()

    monkeypatch.setattr(realm.realm_client, "tree", fails_twice)
    await feed.open()
    await until(lambda: looks >= 1, "the first look")
    feed.hint()
    await until(lambda: looks >= 2, "the second look")
    feed.hint()
    await until(lambda: "arm-1" in store.descriptions, "the third look")
    told = [happening.text for happening in store.entries]
    assert "cannot see the tree: the network is away" in told
    await feed.close()


async def test_a_feed_that_was_just_hinted_at_ends_as_quickly_as_any(realm: Realm) -> None:
    """Its look at the tree is cancelled while it wakes for the hint."""
    feed = Feed(realm.realm_client, Store(), time.monotonic)
    await feed.open()
    await until(lambda: feed._hint._waiters, "nothing more to look at")  # type: ignore[attr-defined]
    feed.hint()
    await asyncio.sleep(0)
    done, _ = await asyncio.wait([asyncio.create_task(feed.close())], timeout=60)
    assert done


@pytest.mark.parametrize("first", ["listing", "presence"])
async def test_who_is_deleted_has_left_whichever_of_the_two_news_comes_first(
    realm: Realm, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine the end of its presence overtakes the lookup service's news, or the other way."""
    store = Store()
    feed = Feed(realm.realm_client, store, time.monotonic)
    begun = ended = 0
    look_once = feed._look

    async def look() -> None:
        nonlocal begun, ended
        begun += 1
        await look_once()
        ended += 1

    monkeypatch.setattr(feed, "_look", look)
    await feed.open()
    await realm.create("move_to.py", "mover")
    await until(lambda: "mover" in store.descriptions, "it is known")
    known = [robot for robot in realm.realm_client.robots() if robot.name == "mover"]
    late = True
    if first == "listing":
        present, left = feed._present, realm.realm_client.left
        monkeypatch.setattr(Feed, "_present", property(lambda _: present if late else set()))
        monkeypatch.setattr(realm.realm_client, "left", lambda address: not late and left(address))
    else:
        listed = realm.realm_client.robots
        monkeypatch.setattr(realm.realm_client, "robots", lambda: [*listed(), *(known if late else ())])
    await realm.realm_client.delete("mover")
    before = begun
    feed.hint()
    await until(lambda: ended > before, "a look between the two")
    late = False
    feed._take_lists()
    await until(lambda: "mover" not in store.known, "it is off the list")
    told = [entry.text for entry in store.entries if "mover" in entry.text and entry.line is None]
    assert told == ["mover (MoveTo) left the list"], "its own log says who created it"
    assert not store.absent
    await feed.close()


async def test_a_host_whose_robots_would_not_survive_its_end_is_told_once(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, looks, trouble = Store(), 0, "its robots would not survive its end now (disk)"
    feed = Feed(realm.realm_client, store, time.monotonic)
    hosts = realm.realm_client.hosts

    async def troubled() -> object:
        nonlocal looks
        looks += 1
        return [replace(host, trouble=trouble if looks < 3 else "") for host in await hosts()]

    monkeypatch.setattr(realm.realm_client, "hosts", troubled)
    await feed.open()
    for look in (1, 2, 3):
        await until(lambda look=look: looks >= look, f"look {look}")  # type: ignore[misc]
        feed.hint()
    await until(
        lambda: "host host-1: its robots are kept again" in [entry.text for entry in store.entries], "end"
    )
    assert [entry.text for entry in store.entries if trouble in entry.text] == [f"host host-1: {trouble}"]
    await feed.close()
