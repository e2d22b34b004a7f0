"""Sites that chose the same name before they met both keep it."""

from __future__ import annotations

import pytest

from robotree.vr.base.errors import SeveralSites
from robotree.vr.lookup.directory import Directory
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import in_virtual_time


@in_virtual_time
async def test_the_own_robot_of_a_name_is_meant_and_of_several_others_none() -> None:
    network = MemoryNetwork()
    gateway, host = network.join("gateway"), network.join("host")
    await gateway.announce("gateway/lab/1")
    for incarnation in ("1", "2"):
        await gateway.announce(f"robot/arm-1/{incarnation}")
    own = await host.announce("robot/arm-1/9")
    directory = Directory(network.join("operator"))
    await directory.start()
    assert (await directory.resolve("arm-1")).incarnation == "9"
    await own.close()
    with pytest.raises(SeveralSites, match="2 other sites have a robot named 'arm-1'"):
        await directory.resolve("arm-1")
    await directory.close()
