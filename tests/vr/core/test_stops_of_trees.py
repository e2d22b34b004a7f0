"""Stops go down the tree, ahead of everything, and whoever did not answer is named at the top."""

from __future__ import annotations

import asyncio
import itertools
import threading
from typing import Any

import pytest

from robotree.vr import Child, CommandCancelled, VirtualRobot, VrError
from robotree.vr.errors import NotConfirmed, NotInControl, Stopped
from robotree.vr.mailbox import LONGEST_QUEUE
from tests.vr.core.crew import Driver, Rover, crew


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
    for agent, commander in ((driver, "driver"), (rover, "driver")):
        epoch = None if agent is driver else agent.description().epoch
        name = "drive" if agent is driver else "move"
        with pytest.raises(Stopped, match=rf"is stopped \(a hand\); .*`robotree resume {commander}`"):
            await realm.client(agent).call(name, {"x": 1}, epoch=epoch)
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
    class Over(VirtualRobot):
        below = Child("Robot")

    top, *others = [await realm.start(Over(f"level-{number}")) for number in range(4)]
    rover = await realm.start(Rover("rover"))
    for parent, child in itertools.pairwise([top, *others, rover]):
        await realm.client(parent).enslave("below", child.address)
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


async def test_an_author_who_blocks_a_hook_does_not_block_the_stop(realm: Any) -> None:
    release = threading.Event()

    class Deaf(Driver):
        def safe_stop(self, reason: str) -> None:  # noqa: ARG002 # deaf
            release.wait()

        def readings(self) -> dict[str, float]:
            release.wait()
            return {}

    driver = await realm.start(Deaf("deaf"))
    rover = await realm.start(Rover("rover"))
    await realm.client(driver).enslave("left", rover.address)
    await asyncio.sleep(3.0)
    with pytest.raises(NotConfirmed, match=r"by rover but NOT by deaf \(its safe_stop has not ended\)"):
        await realm.client(driver).safe_stop("now")
    assert rover.robot.stops == ["now"]
    release.set()
