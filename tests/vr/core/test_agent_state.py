"""What a robot publishes without a request."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.base.errors import CommandCancelled, Stopped
from robotree.vr.base.requests import State, decode_event


class Arm(Robot):
    """An arm."""

    def __init__(self, name: str) -> None:
        super().__init__(name, {"room": "4.03"})
        self.z = 0.5

    @command
    def work(self) -> None:
        for step in range(20):
            self.sleep(0.1)
            self.progress(step / 20)

    @command
    def rest(self) -> None:
        self.sleep(10.0)

    def readings(self) -> dict[str, float]:
        return {"z": self.z, "broken": float("inf"), "name": "arm"}  # type: ignore[dict-item]

    @command(effect="read")
    def height(self) -> float:
        return self.z


class Lever(VirtualRobot):
    arm = Child("Arm")


class Listener:
    def __init__(self) -> None:
        self.heard: list[tuple[float, State]] = []

    def __call__(self, key: str, body: bytes) -> None:
        event = decode_event(body, key=key)
        assert isinstance(event, State)
        self.heard.append((asyncio.get_running_loop().time(), event))

    @property
    def last(self) -> State:
        return self.heard[-1][1]

    def take(self) -> list[tuple[float, State]]:
        heard, self.heard = self.heard, []
        return heard


@pytest.fixture
async def listener(realm: Any) -> Listener:
    listener = Listener()
    await realm.operator.subscribe("robot/*/*/state", listener)
    return listener


async def test_an_idle_robot_tells_once_a_second(realm: Any, listener: Listener) -> None:
    await realm.start(Arm("arm-1"))
    await asyncio.sleep(1.0)
    listener.take()
    await asyncio.sleep(10.0)
    assert 9 <= len(listener.take()) <= 11


async def test_only_numbers_are_readings(realm: Any, listener: Listener) -> None:
    await realm.start(Arm("arm-1"))
    await asyncio.sleep(1.0)
    assert listener.last.readings == {"z": 0.5}


async def test_a_working_robot_tells_ten_times_a_second_how_far_it_is(realm: Any, listener: Listener) -> None:
    arm = await realm.start(Arm("arm-1"))
    working = asyncio.create_task(realm.client(arm).call("work", {}))
    await realm.until(lambda: arm.description().busy == "work")
    listener.take()
    await asyncio.sleep(1.0)
    heard = listener.take()
    assert 9 <= len(heard) <= 11
    assert all(state.busy == "work" for _, state in heard[1:])
    progress = [state.readings["progress"] for _, state in heard[2:]]
    assert progress == sorted(progress)
    await working
    await asyncio.sleep(0.2)
    assert (listener.last.busy, "progress" in listener.last.readings) == ("", False)


async def test_a_working_robot_tells_twice_a_second_what_stays_as_it_is(
    realm: Any, listener: Listener
) -> None:
    arm = await realm.start(Arm("arm-1"))
    resting = asyncio.create_task(realm.client(arm).call("rest", {}))
    await realm.until(lambda: arm.description().busy == "rest")
    await asyncio.sleep(0.2)
    listener.take()
    await asyncio.sleep(5.0)
    assert 8 <= len(listener.take()) <= 11
    arm.robot.z = 0.6
    await asyncio.sleep(0.15)
    assert listener.last.readings == {"z": 0.6}
    await resting


async def test_changes_are_told_soon_but_not_more_than_ten_times_a_second(
    realm: Any, listener: Listener
) -> None:
    arm = await realm.start(Arm("arm-1"))
    await asyncio.sleep(2.0)
    listener.take()
    for n in range(100):
        arm.robot.online = bool(n % 2)
        arm.notify()
        await asyncio.sleep(0.01)
    await asyncio.sleep(0.2)
    heard = listener.take()
    assert len(heard) <= 12
    assert listener.heard == []
    assert heard[-1][1].online


async def test_bond_epoch_and_stop_are_told(realm: Any, listener: Listener) -> None:
    arm, lever = await realm.start(Arm("arm-1")), await realm.start(Lever("lever"))
    await realm.client(lever).enslave("arm", arm.address)
    await realm.client(arm).safe_stop("so")
    listener.take()
    await asyncio.sleep(1.5)
    state = next(state for _, state in reversed(listener.take()) if state.readings)
    assert (state.bond, state.stopped) == (lever.address, True)
    assert state.epoch == arm.description().epoch


async def test_a_robot_that_halts_by_itself_is_stopped_until_it_says_otherwise(
    realm: Any, listener: Listener
) -> None:
    arm = await realm.start(Arm("arm-1"))
    working, waiting = (asyncio.create_task(realm.client(arm).call("work", {})) for _ in range(2))
    await realm.until(lambda: arm.description().waiting == 1)
    arm.robot.halted = "its brakes are shut"
    arm.notify()
    for call in (working, waiting):
        with pytest.raises(CommandCancelled, match="its brakes are shut"):
            await call
    with pytest.raises(Stopped, match=r"arm-1 is stopped \(its brakes are shut\)"):
        await realm.client(arm).call("work", {})
    await asyncio.sleep(0.2)
    assert (listener.last.stopped, listener.last.stop_reason) == (True, "its brakes are shut")
    assert arm.description().stop_reason == "its brakes are shut"
    arm.robot.halted = ""
    arm.notify()
    await asyncio.sleep(0.2)
    assert (listener.last.stopped, listener.last.stop_reason) == (False, "")
    await realm.client(arm).call("work", {})


async def test_a_stop_that_was_ordered_stays_when_the_robots_own_ends(realm: Any) -> None:
    arm = await realm.start(Arm("arm-1"))
    await realm.client(arm).safe_stop("somebody is in the cell")
    arm.robot.halted = "its brakes are shut"
    assert arm.description().stop_reason == "somebody is in the cell"
    arm.robot.halted = ""
    assert arm.description().stopped
    await realm.client(arm).resume()
    assert not arm.description().stopped


async def test_attributes_and_their_changes_reach_the_lookup(realm: Any) -> None:
    arm = await realm.start(Arm("arm-1"))
    await realm.until(lambda: realm.listed() == ["arm-1"])
    assert realm.listings()[0].attributes == {"room": "4.03"}
    assert realm.listings()[0].doc == "An arm."
    assert realm.listings()[0].kinds == ("Arm", "Robot")
    arm.robot.attributes["room"] = "5.01"
    arm.notify()
    await realm.until(lambda: realm.listings()[0].attributes == {"room": "5.01"}, within=1.0)


async def test_a_robot_that_is_listed_can_be_called_at_once(realm: Any) -> None:
    """It serves before it is seen, and is seen before it is listed."""
    answers: list[Any] = []

    def seen(key: str, there: bool) -> None:  # noqa: FBT001 # a presence handler
        if there and key.startswith("robot/"):
            agent = next(member for member in realm.network.members if key in member.served)
            answers.append(agent)

    realm.operator.presence.watch("robot/*/*", seen)
    await realm.start(Arm("arm-1"))
    assert len(answers) == 1


@pytest.mark.parametrize("turns", range(4))
async def test_a_robot_that_has_just_changed_ends_as_quickly_as_any(realm: Any, turns: int) -> None:
    """Its news are cancelled while they wake for the change."""
    arm = await realm.start(Arm("arm-1"), registrar=None)
    await asyncio.sleep(0.5)
    arm.runtime.changed()
    for _ in range(turns):
        await asyncio.sleep(0)
    realm.agents.remove(arm)  # which would wait for it as long
    asked = realm.runner.now()
    await arm.close()
    assert realm.runner.now() < asked + 5


async def test_a_call_that_only_reads_publishes_no_state(realm: Any, listener: Listener) -> None:
    arm = await realm.start(Arm("arm"))
    await asyncio.sleep(5.0)
    listener.take()
    await asyncio.sleep(5.0)
    alone = len(listener.take())
    for _ in range(50):
        await realm.client(arm).call("height", {})
        await asyncio.sleep(0.1)
    assert len(listener.take()) <= alone + 1
    working = asyncio.create_task(realm.client(arm).call("work", {}))
    await asyncio.sleep(0.3)
    assert listener.last.busy == "work"
    await realm.client(arm).call("height", {})
    await working
    await asyncio.sleep(0.2)
    assert listener.last.busy == ""
