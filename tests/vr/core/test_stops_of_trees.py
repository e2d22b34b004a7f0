"""Stops go down the tree, ahead of everything, and robots that did not answer are named at the top."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any

import pytest

from robotree.vr import Child, CommandCancelled, VirtualRobot, VrError
from robotree.vr.base.errors import NotConfirmed, NotInControl, Stopped
from robotree.vr.core.machine import LONGEST_QUEUE
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.core.crew import Driver, Rover, crew
from tests.vr.core.gate import Gate


async def test_a_stop_goes_ahead_of_everything_and_down_to_the_hardware(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    client = realm.client(driver)
    calls = [asyncio.create_task(client.call("both", {"length": 5})) for _ in range(LONGEST_QUEUE + 1)]
    await realm.until(lambda: left.description().busy == right.description().busy == "move")
    await realm.until(lambda: driver.description().waiting == LONGEST_QUEUE)
    loop = asyncio.get_running_loop()
    began = loop.time()
    await client.safe_stop("a hand in the cell")
    assert loop.time() - began < 0.2
    assert left.robot.stops == right.robot.stops == ["a hand in the cell"]
    results = await asyncio.gather(*calls, return_exceptions=True)
    assert {type(result) for result in results} == {CommandCancelled}
    assert "a hand in the cell" in str(results[0])
    assert left.robot.x < 0.5


async def test_a_stopped_robot_refuses_commands_until_it_is_released(realm: Any) -> None:
    driver, rover = await crew(realm)
    client = realm.client(driver)
    await client.safe_stop("a hand")
    parent = RobotClient(driver.transport, rover.address, sender=driver.address.key)
    for asker, name, epoch in ((client, "drive", None), (parent, "move", rover.description().epoch)):
        with pytest.raises(Stopped, match=r"is stopped \(a hand\); .*`robotree resume driver`"):
            await asker.call(name, {"x": 1}, epoch=epoch)
    assert (await client.call("get_info", {}))["moves"] == 0  # what only reads is no danger
    with pytest.raises(NotInControl):
        await realm.client(rover).resume()
    await client.resume()
    assert rover.robot.stops == ["a hand", "resumed"]
    await client.call("drive", {"x": 1})


async def test_a_stop_that_does_not_reach_a_child_says_so_but_reaches_the_others(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    realm.network.lease = 1000.0
    realm.network.freeze(left.transport)
    with pytest.raises(VrError, match=r"by driver, rover-right but NOT by rover-left \(it did not"):
        await realm.client(driver).safe_stop("look out")
    assert right.robot.stops == ["look out"]
    realm.network.thaw(left.transport)


async def test_in_a_deep_tree_the_error_names_the_robot_that_did_not_answer(realm: Any) -> None:
    realm.network.delay = 0.06
    top, *_, rover = await tower(realm, 4)
    realm.network.lease = 1000.0
    realm.network.freeze(rover.transport)
    loop = asyncio.get_running_loop()
    for order, who in (
        (realm.client(top).safe_stop, "level-0, level-1, level-2, level-3"),
        (realm.client(top).resume, "nobody"),  # each waits for those below it
    ):
        began = loop.time()
        with pytest.raises(NotConfirmed, match=rf"by {who} but NOT by rover \(it did not answer\)"):
            await order(timeout=1.0)
        assert loop.time() - began < 1.0
    realm.network.thaw(rover.transport)


class Over(VirtualRobot):
    """One level of a tree."""

    below = Child("Robot")


async def tower(realm: Any, levels: int) -> list[Any]:
    """Return a chain of robots, the topmost first; the rover at its foot moves."""
    agents = [await realm.start(Over(f"level-{number}")) for number in range(levels)]
    agents.append(await realm.start(Rover("rover")))
    for parent, child in reversed(list(itertools.pairwise(agents))):
        await realm.client(parent).enslave("below", child.address)
    return agents


async def test_of_thirty_levels_on_a_slow_way_each_one_that_has_stopped_is_said_to_have_stopped(
    realm: Any,
) -> None:
    realm.network.delay = 0.03
    agents = await tower(realm, 30)
    realm_client = RealmClient(realm.network.join("supervisor"))
    await realm_client.start()
    names = sorted(agent.address.name for agent in agents)
    assert sorted(await realm_client.stop("level-0")) == names
    assert sorted(await realm_client.resume("level-0")) == names
    before = [agent.description().stops for agent in agents]
    assert sorted(await realm_client.stop(None)) == names
    assert sorted(await realm_client.resume(None)) == names
    assert [agent.description().stops for agent in agents] == [stops + 1 for stops in before], (
        "one order is one stop, by however many ways it comes"
    )
    await realm_client.close()


async def test_nothing_is_released_while_a_robot_still_stops_whatever_hook_its_author_blocks(
    realm: Any,
) -> None:
    ended = Gate()

    class Slow(Driver):
        def safe_stop(self, reason: str) -> None:  # noqa: ARG002 # slow
            ended.wait()

        def readings(self) -> dict[str, float]:
            ended.wait()
            return {}

    driver = await realm.start(Slow("slow"))
    rover = await realm.start(Rover("rover"))
    client = realm.client(driver)
    await client.enslave("left", rover.address)
    await asyncio.sleep(3.0)  # its readings are asked for meanwhile
    with pytest.raises(NotConfirmed, match=r"by rover but NOT by slow \(its safe_stop has not ended\)"):
        await client.safe_stop("a hand", timeout=0.5)
    with pytest.raises(NotConfirmed, match=r"NOT by slow \(its safe_stop has not ended\)"):
        await client.resume(timeout=0.5)
    with pytest.raises(Stopped):
        await client.call("drive", {"x": 1})
    assert rover.robot.stops == ["a hand"], "nor those below it"
    ended.set()
    await client.resume()
    await client.call("drive", {"x": 1})
