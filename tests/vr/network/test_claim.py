"""Names: one living agent has each, also if two came at the same moment."""

from __future__ import annotations

import asyncio

import pytest

from robotree.vr.base.address import Address, Role
from robotree.vr.base.errors import DuplicateName, NameInSilence
from robotree.vr.exchange.claim import claim, new_address
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import in_virtual_time


@in_virtual_time
async def test_a_name_whose_holder_hangs_is_not_given_to_another() -> None:
    """When it wakes there would be two, and each would take the children for its own."""
    network = MemoryNetwork()
    one, other = network.join("one"), network.join("other")
    held = await claim(one, new_address("robot", "arm"))
    network.freeze(one)
    await asyncio.sleep(2 * network.lease)
    assert not other.presence.keys("robot/**")
    with pytest.raises(NameInSilence, match=r"a robot named 'arm' is in one, which hangs; choose .*thaw"):
        await claim(other, new_address("view", "arm"))
    network.kill(one)
    await claim(other, new_address("robot", "arm"))
    await held.close()


@pytest.mark.parametrize(("first", "second"), [("robot", "robot"), ("robot", "view"), ("view", "robot")])
@in_virtual_time
async def test_a_name_is_refused_until_its_holder_has_gone_but_a_host_may_have_that_of_a_robot(
    first: Role, second: Role
) -> None:
    network = MemoryNetwork()
    one, other = network.join(), network.join()
    held = await claim(one, new_address(first, "cell"))
    with pytest.raises(DuplicateName, match=f"a {first} named 'cell' is already running"):
        await claim(other, new_address(second, "cell"))
    await claim(other, new_address("host", "cell"))
    await claim(other, new_address("lookup", "cell"))
    await held.close()
    await claim(other, new_address(second, "cell"))
    assert len(one.presence.keys("*/cell/*")) == 3


@in_virtual_time
async def test_a_holder_that_is_just_leaving_is_waited_for() -> None:
    network = MemoryNetwork(delay=0.02)
    one, other = network.join(), network.join()
    held = await claim(one, new_address("robot", "arm"))
    asyncio.get_running_loop().call_later(0.05, lambda: asyncio.ensure_future(held.close()))
    assert await claim(other, new_address("robot", "arm"))


@pytest.mark.parametrize("role", ["robot", "view"])
@in_virtual_time
async def test_of_two_who_wait_for_a_holder_to_leave_exactly_one_stays(role: Role) -> None:
    """Both see it go at the same moment, and neither sees the other before it has announced itself."""
    network = MemoryNetwork(delay=0.04)
    holder, *waiting = (network.join() for _ in range(3))
    held = await claim(holder, Address("robot", "arm", "0"))
    asyncio.get_running_loop().call_later(0.02, lambda: asyncio.ensure_future(held.close()))
    await asyncio.sleep(0.05)
    addresses = Address("robot", "arm", "1"), Address(role, "arm", "2")
    one, other = await asyncio.gather(*map(claim, waiting, addresses), return_exceptions=True)
    assert not isinstance(one, BaseException), "the smaller address"
    assert isinstance(other, DuplicateName)
