"""A robot fills its own slots: with one that is free and fits, by bids, and by the robot's own lease."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotree.vr import Child, Children, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.errors import NobodyFits, NotFree, RequirementUnreadable, SlotOccupied
from robotree.vr.base.group import RobotGroup
from robotree.vr.base.requests import Petition
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.group_file import groups_beside
from robotree.vr.network.policy_file import PolicyFile
from tests.vr.core.conftest import Realm


class Rover(Robot):
    """A rover."""

    def __init__(self, name: str, place: str = "hall", **says: float) -> None:
        super().__init__(name, {"place": place})
        self.says = says

    def readings(self) -> dict[str, float]:
        return self.says

    @command
    def move(self, x: float) -> None:
        """Drive."""
        self.sleep(x)


class Guide(VirtualRobot):
    """Has one led."""

    rover = Child("Rover", choose="free", where="battery > 30 and near hall", returns=2.0)

    @command
    def lead(self) -> str:
        self.rover.move(x=1.0)
        return "done"


class Waiting(VirtualRobot):
    """Does not choose by itself."""

    rover = Child("Rover", optional=True)


class Pack(VirtualRobot):
    rovers = Children("Rover", choose="free", count=2)


def held(agent: Any, slot: str = "rover") -> str:
    spec = agent.description().slot(slot)
    return "" if spec is None or spec.child is None else spec.child.name


def slot_of(agent: RobotAgent | RobotDescription) -> SlotSpec:
    robot = agent.description() if isinstance(agent, RobotAgent) else agent
    found = robot.slot("rover")
    assert found is not None
    return found


def child_of(robot: RobotDescription) -> str:
    child = slot_of(robot).child
    assert child is not None
    return child.name


def petition(parent: RobotAgent) -> Petition:
    return Petition(
        parent=parent.address, slot="rover", kind="Rover", lineage=("w",), term=5.0, key="k1", idle=True
    )


def lines(agent: Any) -> list[str]:
    return [line.text for line in agent.runtime.log.since(0)]


async def test_of_those_that_are_free_and_fit_one_is_bound_and_the_reason_is_told(realm: Realm) -> None:
    await realm.start(Rover("empty", battery=20.0))
    await realm.start(Rover("away", "kitchen", battery=80.0))
    fit = await realm.start(Rover("fit", battery=80.0))
    guide = await realm.start(Guide("guide"))
    await realm.until(lambda: held(guide) == "fit")
    why = slot_of(guide).why
    assert why.startswith("fit is free and has battery 80, place hall; it was the only one"), why
    assert "empty does not fit (battery 20, place hall)" in why
    assert f"rover: {why}" in lines(guide)
    bond = fit.description().bond
    assert bond is not None
    assert bond.parent.name == "guide"
    assert await realm.client(guide).call("lead", {}, deadline=10.0, caller="operator") == "done"


async def test_the_cheapest_bid_is_taken_and_then_the_quickest(realm: Realm) -> None:
    await realm.start(Rover("dear", battery=80.0, bid_cost=2.0))
    await realm.start(Rover("slow", battery=80.0, bid_cost=1.0, bid_time=9.0))
    await realm.start(Rover("good", battery=80.0, bid_cost=1.0, bid_time=3.0))
    guide = await realm.start(Guide("guide"))
    await realm.until(lambda: held(guide) != "")
    slot = slot_of(guide)
    assert held(guide) == "good"
    assert "cost 1, time 3 s" in slot.why
    assert "it bids less than" in slot.why
    assert "dear (cost 2)" in slot.why


async def test_one_that_works_is_not_taken_away_from_who_uses_it(realm: Realm) -> None:
    busy = await realm.start(Rover("busy", battery=80.0))
    work = asyncio.ensure_future(
        realm.client(busy).call("move", {"x": 5.0}, deadline=60.0, caller="operator")
    )
    await realm.until(lambda: busy.description().busy == "move")
    guide = await realm.start(Guide("guide"))
    await realm.until(lambda: any("rover stays empty" in line for line in lines(guide)))
    assert held(guide) == ""
    assert any("busy carries out move" in line for line in lines(guide))
    await work  # was not cancelled
    await realm.until(lambda: held(guide) == "busy")


async def test_who_is_busy_by_the_time_of_the_petition_refuses_and_goes_on(realm: Realm) -> None:
    """The bid was free: only the robot's own lease knows what has come since."""
    rover, waiting = await realm.start(Rover("r1")), await realm.start(Waiting("w"))
    parent = RobotClient(waiting.transport, rover.address, sender=waiting.address.key)
    work = asyncio.ensure_future(
        realm.client(rover).call("move", {"x": 5.0}, deadline=60.0, caller="operator")
    )
    await realm.until(lambda: rover.description().busy == "move")
    with pytest.raises(NotFree, match="r1 is not free to be chosen: it has move to carry out"):
        await parent.petition(petition(waiting))
    assert rover.description().busy == "move"
    assert held(waiting) == ""
    await work
    assert await parent.petition(petition(waiting))


async def test_a_petition_that_came_twice_is_granted_twice(realm: Realm) -> None:
    rover, waiting = await realm.start(Rover("r1")), await realm.start(Waiting("w"))
    parent = RobotClient(waiting.transport, rover.address, sender=waiting.address.key)
    first, again = await parent.petition(petition(waiting)), await parent.petition(petition(waiting))
    assert again.epoch >= first.epoch


async def test_a_stopped_one_is_not_free(realm: Realm) -> None:
    rover = await realm.start(Rover("r1", battery=80.0))
    await realm.client(rover).safe_stop("a person")
    guide = await realm.start(Guide("guide"))
    await realm.until(lambda: any("r1 is stopped" in line for line in lines(guide)))
    assert held(guide) == ""
    await realm.client(rover).resume()
    await realm.until(lambda: held(guide) == "r1")


async def test_the_same_one_again_if_it_comes_back_in_time_else_another(realm: Realm) -> None:
    first = await realm.start(Rover("r1", battery=80.0))
    guide = await realm.start(Guide("guide"))
    await realm.until(lambda: held(guide) == "r1")
    await realm.start(Rover("r2", battery=80.0))
    realm.kill(first)
    await realm.until(lambda: held(guide) == "")
    again = await realm.start(Rover("r1", battery=80.0))
    await realm.until(lambda: held(guide) != "")
    assert held(guide) == "r1"
    assert slot_of(guide).why == "r1 came back in time"
    realm.kill(again)
    await realm.until(lambda: held(guide) == "")
    waited = await realm.until(lambda: held(guide) != "")
    assert held(guide) == "r2"
    assert 1.0 < waited < 5.0  # [s] virtual: `returns` is 2 s


async def test_what_a_person_releases_stays_released_until_a_person_asks(realm: Realm) -> None:
    await realm.start(Rover("r1", battery=80.0))
    guide = await realm.start(Guide("guide"))
    await realm.until(lambda: held(guide) == "r1")
    await realm.client(guide).free("rover")
    await asyncio.sleep(10.0)
    assert held(guide) == ""
    await realm.client(guide).choose("rover", "")
    assert held(guide) == "r1"


async def test_a_person_has_one_chosen_for_any_slot(realm: Realm) -> None:
    await realm.start(Rover("r1", battery=20.0))
    await realm.start(Rover("r2", battery=80.0))
    waiting = await realm.start(Waiting("w"))
    robot = await realm.client(waiting).choose("rover", "battery > 30")
    assert child_of(robot) == "r2"
    assert "r2 is free" in slot_of(robot).why
    with pytest.raises(SlotOccupied):
        await realm.client(waiting).choose("rover", "")
    await realm.client(waiting).free("rover")
    with pytest.raises(NobodyFits, match=r"w\.rover stays empty: none of 2 Rover fits where battery > 90: "):
        await realm.client(waiting).choose("rover", "battery > 90")
    with pytest.raises(RequirementUnreadable, match="something is missing at the end"):
        await realm.client(waiting).choose("rover", "battery >")


async def test_nobody_of_the_kind_is_told(realm: Realm) -> None:
    waiting = await realm.start(Waiting("w"))
    with pytest.raises(NobodyFits, match="no Rover is listed as free"):
        await realm.client(waiting).choose("rover", "")


async def test_so_many_of_a_group_are_chosen_as_it_counts(realm: Realm) -> None:
    for number in range(4):
        await realm.start(Rover(f"r{number}"))
    pack = await realm.start(Pack("pack"))
    await realm.until(lambda: len(pack.runtime.look(lambda state: state.slots.bonds())) == 2)
    await asyncio.sleep(5.0)
    assert len(pack.runtime.look(lambda state: state.slots.bonds())) == 2


async def test_twenty_that_choose_at_once_get_twenty_different_ones(realm: Realm) -> None:
    for number in range(25):
        await realm.start(Rover(f"r{number}", battery=80.0))
    await realm.until(lambda: len(realm.listed()) == 25)
    guides = await asyncio.gather(*(realm.start(Guide(f"g{number}")) for number in range(20)))
    await realm.until(lambda: all(map(held, guides)))
    assert len({held(guide) for guide in guides}) == 20


async def test_one_is_chosen_out_of_a_group(realm: Realm, tmp_path: Path) -> None:
    realm.network.gate = PolicyFile(tmp_path)
    groups_beside(realm.network.gate).write(RobotGroup(name="cleaners", names=("r3",), rule="battery > 90"))
    waiting = await realm.start(Waiting("w"))
    for number in range(5):
        await realm.start(Rover(f"r{number}", battery=50.0))
    await realm.until(lambda: len(realm.listed()) == 6)
    assert child_of(await realm.client(waiting).choose("rover", "in cleaners")) == "r3"


def test_a_choice_that_cannot_be_made_is_refused_when_the_page_is_made() -> None:
    with pytest.raises(TypeError, match=r'write choose="free"'):
        Child("Rover", choose="best")  # type: ignore[call-overload]
    with pytest.raises(TypeError, match=r'write choose="free", too'):
        Child("Rover", where="battery > 3")
    with pytest.raises(TypeError, match="instead of least and most"):
        Children("Rover", count=2, most=3)
