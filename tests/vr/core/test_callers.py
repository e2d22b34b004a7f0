"""A command ends with the program that has called it, however that ends."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from robotree.vr.agents.callers import LINGER
from robotree.vr.base.errors import CommandCancelled
from robotree.vr.base.presence import Presence
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryTransport
from tests.vr.core.crew import Rover, crew


class Operator:
    """A program of an operator, on a transport of its own."""

    def __init__(self, realm: Any) -> None:
        self.realm = realm
        self.transport: MemoryTransport = realm.network.join("shell")
        self.realm_client = RealmClient(self.transport)
        self.calls: list[asyncio.Task[Any]] = []

    def call(self, name: str, command: str, **arguments: float) -> None:
        self.calls.append(asyncio.create_task(self.realm_client.call(name, command, arguments)))

    async def moves(self) -> Any:
        """Have a rover move, and return it."""
        rover = await self.realm.start(Rover("rover"))
        self.call("rover", "move", x=5)
        await self.realm.until(lambda: running(rover) == ["move"])
        return rover

    def kill(self) -> None:
        self.realm.network.kill(self.transport)


@pytest.fixture
async def operator(realm: Any) -> AsyncIterator[Operator]:
    operator = Operator(realm)
    await operator.realm_client.start()
    yield operator
    for call in operator.calls:
        call.cancel()
    await asyncio.gather(*operator.calls, return_exceptions=True)
    await operator.realm_client.close()


def running(*agents: Any) -> list[str]:
    return [agent.description().busy for agent in agents]


async def test_a_killed_caller_ends_its_command_down_to_the_hardware(realm: Any, operator: Operator) -> None:
    driver, rover = await crew(realm)
    operator.call("driver", "square", length=5)
    await realm.until(lambda: running(driver, rover) == ["square", "move"])
    operator.kill()
    assert await realm.until(lambda: running(driver, rover) == ["", ""]) < 0.2
    assert rover.robot.x < 1
    await realm.client(driver).call("drive", {"x": 0.1})  # the next one may move it


async def test_a_stopped_caller_ends_its_command_when_its_presence_is_over(
    realm: Any, operator: Operator
) -> None:
    rover = await operator.moves()
    realm.network.freeze(operator.transport)
    assert 1.9 < await realm.until(lambda: running(rover) == [""]) < 2.2
    realm.network.thaw(operator.transport)
    (error,) = await asyncio.gather(*operator.calls, return_exceptions=True)
    assert "in the middle" in str(error) or isinstance(error, CommandCancelled)


async def test_what_waits_ends_with_its_caller_and_what_others_have_called_goes_on(
    realm: Any, operator: Operator
) -> None:
    rover = await realm.start(Rover("rover"))
    other = asyncio.create_task(realm.client(rover).call("move", {"x": 3}))
    await realm.until(lambda: running(rover) == ["move"])
    operator.call("rover", "move", x=5)
    await realm.until(lambda: rover.description().waiting == 1)
    operator.kill()
    await realm.until(lambda: rover.description().waiting == 0, within=0.2)
    await other
    assert rover.robot.x == pytest.approx(3)


async def test_a_command_that_was_only_told_goes_on_without_its_caller(
    realm: Any, operator: Operator
) -> None:
    rover = await realm.start(Rover("rover"))
    await operator.realm_client.tell("rover", "move", {"x": 3})
    operator.kill()
    await realm.until(lambda: running(rover) == [""])
    assert rover.robot.x == pytest.approx(3)


async def test_a_caller_that_calls_again_and_again_is_watched_once_and_still_guarded(
    realm: Any, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover = await realm.start(Rover("rover"))
    begun: list[str] = []
    watch = Presence.watch

    def counted(self: Presence, key: str, handler: Any) -> Any:
        begun.extend([key] if key.startswith("caller/") else [])
        return watch(self, key, handler)

    monkeypatch.setattr(Presence, "watch", counted)
    for _ in range(5):
        await operator.realm_client.call("rover", "move", {"x": 0.01})
    assert len(begun) == 1
    await asyncio.sleep(2 * LINGER + 1)  # then it is forgotten
    operator.call("rover", "move", x=5)
    await realm.until(lambda: running(rover) == ["move"])
    assert len(begun) == 2
    operator.kill()
    await realm.until(lambda: running(rover) == [""], within=0.2)


async def test_a_caller_that_was_never_there_is_not_obeyed_for_long(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    client = RobotClient(realm.operator, rover.address)
    with pytest.raises(CommandCancelled, match="its caller has gone"):
        await client.call("move", {"x": 5}, sender="caller/nobody")
    assert rover.robot.x < 1


async def test_a_caller_that_closes_in_order_leaves_nothing_running(realm: Any, operator: Operator) -> None:
    rover = await operator.moves()
    await operator.realm_client.close()
    await realm.until(lambda: running(rover) == [""], within=0.2)


async def test_a_command_that_both_of_two_have_called_ends_with_the_second(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    members = [realm.network.join(name) for name in ("one", "two")]
    calls = []
    for number, member in enumerate(members):
        await member.announce(f"caller/{number}")
        client = RobotClient(member, rover.address)
        calls.append(asyncio.create_task(client.call("move", {"x": 5}, key="k", sender=f"caller/{number}")))
    await realm.until(lambda: running(rover) == ["move"])
    await asyncio.sleep(0.1)
    realm.network.kill(members[0])
    await asyncio.sleep(0.5)
    assert running(rover) == ["move"]
    realm.network.kill(members[1])
    await realm.until(lambda: running(rover) == [""], within=0.2)
    await asyncio.gather(*calls, return_exceptions=True)


# -- nobody is left who could end it ---------------------------------------------------------------


async def test_a_robot_that_nobody_can_reach_any_more_ends_its_motion_and_says_why(
    realm: Any, operator: Operator, caplog: pytest.LogCaptureFixture
) -> None:
    rover = await realm.start(Rover("rover"))
    await operator.realm_client.tell("rover", "move", {"x": 5})
    await realm.until(lambda: running(rover) == ["move"])
    realm.network.unlist(rover.transport)
    await asyncio.sleep(1.0)
    assert running(rover) == ["move"], "those who know it can still end it"
    for other in list(realm.network.members):
        if other is not rover.transport:
            realm.network.cut(rover.transport, other)
    await realm.until(lambda: running(rover) == [""], within=3.0)
    assert rover.robot.x < 4.9
    assert "rover ends its commands: no other process can reach it: its entry is gone" in caplog.text
    for other in list(realm.network.members):
        if other is not rover.transport:
            realm.network.heal(rover.transport, other)
    await realm.until(lambda: bool(operator.realm_client.directory.present("robot")))
    await operator.realm_client.call("rover", "move", {"x": 0.1})


async def test_a_robot_that_others_can_find_goes_on_alone(realm: Any, operator: Operator) -> None:
    rover = await realm.start(Rover("rover"))
    await operator.realm_client.tell("rover", "move", {"x": 3})
    await realm.until(lambda: running(rover) == ["move"])
    for other in list(realm.network.members):
        if other is not rover.transport:
            realm.network.cut(rover.transport, other)
    await realm.until(lambda: running(rover) == [""])
    assert rover.robot.x == pytest.approx(3)
