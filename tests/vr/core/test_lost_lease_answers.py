"""A lease whose answer is lost: the child must not stay bound to a parent that does not know of it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot
from robotree.vr.agents.children import REUNION
from robotree.vr.base.envelope import opened
from robotree.vr.base.errors import NoAnswer, Unreachable
from robotree.vr.base.requests import Petition
from robotree.vr.world.network import MemoryTransport


class Rover(Robot):
    """A rover."""


class Pair(VirtualRobot):
    left = Child("Rover")


class Forgetful(MemoryTransport):
    """Loses the answers to petitions on their way back."""

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        replies = super().request(key, body, timeout=timeout, urgent=urgent, void_at=void_at)
        asked = opened(body, self.identity, "it", self.loop.time()).request
        return self._lose(key, replies, timeout) if isinstance(asked, Petition) else replies

    async def _lose(self, key: str, replies: AsyncIterator[bytes], timeout: float) -> AsyncIterator[bytes]:
        self.lost = [reply async for reply in replies]
        await asyncio.sleep(timeout)
        raise NoAnswer(key=key, seconds=timeout)
        yield b""


@pytest.mark.parametrize("how", ["it waits in vain", "its asker goes away"])
async def test_a_child_that_its_parent_does_not_know_it_has_is_free_again(realm: Any, how: str) -> None:
    rover = await realm.start(Rover("rover"), term=600.0)
    transport = Forgetful(realm.network, "pair")
    realm.network.enter(transport)
    pair = await realm.start(Pair("pair"), transport, term=600.0)
    enslaving = asyncio.create_task(pair._children.enslave("left", rover.address))
    await realm.until(lambda: rover.description().bond is not None)
    if how == "its asker goes away":
        enslaving.cancel()
    with pytest.raises((NoAnswer, asyncio.CancelledError)):
        await enslaving
    await realm.until(lambda: rover.description().bond is None, within=1.0)
    assert pair.description().slot("left").child is None
    transport.__class__ = MemoryTransport  # type: ignore[assignment] # the way is good again
    await realm.client(pair).enslave("left", rover.address)
    assert rover.description().bond is not None


async def test_a_petition_that_comes_after_it_was_taken_back_is_refused(realm: Any) -> None:
    """The child's process was stopped; when it goes on, it finds the petition and its retraction."""
    rover = await realm.start(Rover("rover"), term=600.0)
    pair = await realm.start(Pair("pair"), term=600.0)
    realm.network.lease = 1000.0
    realm.network.freeze(rover.transport)
    with pytest.raises(NoAnswer):
        await realm.client(pair, patience=20.0).enslave("left", rover.address)
    await asyncio.sleep(1.0)
    realm.network.thaw(rover.transport)
    await asyncio.sleep(1.0)
    assert rover.description().bond is None
    await realm.client(pair).enslave("left", rover.address)


async def test_a_child_whose_link_is_just_coming_back_is_waited_for(realm: Any) -> None:
    """One of the two hung for longer than the network's lease, and has just woken."""
    rover = await realm.start(Rover("rover"))
    pair = await realm.start(Pair("pair"))
    realm.network.cut(pair.transport, rover.transport)
    await asyncio.sleep(2 * realm.network.lease)
    enslaving = asyncio.create_task(realm.client(pair).enslave("left", rover.address))
    await asyncio.sleep(REUNION / 2)
    realm.network.heal(pair.transport, rover.transport)
    await enslaving
    assert rover.description().bond is not None


async def test_the_wait_for_a_link_is_no_part_of_the_lease(realm: Any) -> None:
    rover = await realm.start(Rover("rover"), term=1.0)
    pair = await realm.start(Pair("pair"), term=1.0)
    realm.network.cut(pair.transport, rover.transport)
    await asyncio.sleep(2 * realm.network.lease)
    enslaving = asyncio.create_task(realm.client(pair).enslave("left", rover.address))
    await asyncio.sleep(1.5)
    realm.network.heal(pair.transport, rover.transport)
    await enslaving
    await asyncio.sleep(3.0)
    assert pair.description().slot("left").child == rover.address
    assert rover.description().bond is not None


async def test_a_child_that_is_dead_is_not_waited_for(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    pair = await realm.start(Pair("pair"))
    realm.network.kill(rover.transport)
    asked = asyncio.get_running_loop().time()
    with pytest.raises(Unreachable):
        await realm.client(pair).enslave("left", rover.address)
    assert asyncio.get_running_loop().time() - asked < REUNION / 2


async def test_a_child_whose_link_stays_away_is_given_up(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    pair = await realm.start(Pair("pair"))
    realm.network.cut(pair.transport, rover.transport)
    await asyncio.sleep(2 * realm.network.lease)
    asked = asyncio.get_running_loop().time()
    with pytest.raises(Unreachable):
        await realm.client(pair).enslave("left", rover.address)
    assert REUNION <= asyncio.get_running_loop().time() - asked < REUNION + 1
