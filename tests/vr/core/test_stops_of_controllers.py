"""Stops that a robot reports itself, because its controller was stopped directly, count as ordered ones."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import Any

import pytest

from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import NotConfirmed
from robotree.vr.supervision.realm_client import RealmClient

HELD = "its controller is in safe stop"


class Rover(Robot):
    """A rover that others may stop, too."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.releases: list[asyncio.Future[None]] = []
        self.moves = 0

    @command
    def move(self, x: float) -> None:
        self.moves += x > 0

    def resume(self) -> Awaitable[None] | None:
        self.releases.append(asyncio.get_running_loop().create_future())
        return self.releases[-1]


def tell(rover: RobotAgent, halted: str) -> None:
    rover.robot.halted = halted
    rover.notify()


async def test_a_release_ends_no_stop_that_the_controller_told_of_after_it_was_asked_for(
    realm: Any, realm_client: RealmClient
) -> None:
    rover = await realm.start(Rover("rover"))
    realm.network.delay = 0.3
    resuming = asyncio.create_task(realm_client.resume("rover"))
    await asyncio.sleep(0.7)
    tell(rover, HELD)
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(it was stopped again after that had been asked"):
        await resuming
    assert rover.robot.releases == [], "the controller hears of none"
    resuming = asyncio.create_task(realm_client.resume("rover"))
    await realm.until(lambda: bool(rover.robot.releases))
    tell(rover, "")
    rover.robot.releases[0].set_result(None)
    assert await resuming == ["rover"]


async def test_a_stop_counts_once_however_often_it_is_told(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    for halted in (HELD, f"{HELD}: somebody asked for it", HELD):
        tell(rover, halted)
        await asyncio.sleep(0)
    assert rover.description().stops == 1
    tell(rover, "")
    tell(rover, HELD)
    await asyncio.sleep(0)
    assert rover.description().stops == 2, "it has ended and begun within one turn of the loop"


async def test_a_resume_does_not_wait_for_who_is_offline_and_was_never_stopped(
    realm: Any, realm_client: RealmClient
) -> None:
    near, far = await realm.start(Rover("near")), await realm.start(Rover("far"))
    far.robot.online = False
    await realm_client.stop("near")
    resuming = asyncio.create_task(realm_client.resume(None))
    await realm.until(lambda: bool(near.robot.releases))
    near.robot.releases[0].set_result(None)
    assert await resuming == ["near"]
    assert far.robot.releases == []


async def test_a_resume_names_who_is_offline_and_stays_stopped(realm: Any, realm_client: RealmClient) -> None:
    rover = await realm.start(Rover("rover"))
    await realm_client.stop(None)
    rover.robot.online = False
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(it is offline, and its controller has not"):
        await realm_client.resume(None)


async def test_a_resume_that_meets_another_one_under_way_waits_as_well(realm: Any) -> None:
    """What is being released tells no stop any more, and is not confirmed yet."""
    rover = await realm.start(Rover("rover"))
    tell(rover, HELD)
    first = asyncio.create_task(realm.client(rover).resume())
    await realm.until(lambda: len(rover.robot.releases) == 1)
    tell(rover, "")
    second = asyncio.create_task(realm.client(rover).resume())
    await realm.until(lambda: len(rover.robot.releases) == 2)
    for release in rover.robot.releases:
        release.set_result(None)
    assert await first == await second == ("rover",)
