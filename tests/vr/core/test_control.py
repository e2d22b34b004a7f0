"""Control of a robot: who has it, asks for it, is offered it or takes it; what is left of who vanishes."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from typing import Any

import pytest

from robotree.vr.base.address import everyone
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import (
    CommandCancelled,
    ControlRefused,
    Denied,
    HeldByOperator,
    NotInControl,
    VrError,
)
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import user_name
from robotree.vr.core.control import LONGEST, OPEN_FOR
from robotree.vr.core.machine import RobotState, decode_state, encode_state
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.core.crew import Driver, Rover, crew

ME = user_name(os.geteuid())


class Person:
    """An operator at a terminal; one of them does something at a time."""

    def __init__(self, realm: Any, terminal: str) -> None:
        self.terminal, self.name = terminal, f"{ME}@{terminal}"
        self.transport = realm.network.join(terminal.replace("/", "-"))
        self.client = RealmClient(self.transport)

    async def control(self, what: Any, robot: str = "rover", **named: Any) -> str:
        await until_there(self, robot)
        with sitting_at(self.terminal):
            return await self.client.control(robot, what, **named)

    async def move(self, robot: str = "rover", x: float = 0.1) -> None:
        await until_there(self, robot)
        with sitting_at(self.terminal):
            await self.client.call(robot, "move", {"x": x})


async def until_there(person: Person, robot: str) -> None:
    presence = person.transport.presence
    assert await presence.until(everyone("robot", robot), there=True, within=60.0)


@pytest.fixture
async def people(realm: Any) -> AsyncIterator[list[Person]]:
    found = [Person(realm, f"pts/{number}") for number in (1, 2, 3)]
    for each in found:
        await each.client.start()
    yield found
    for each in found:
        await each.client.close()


def shown(rover: Any) -> tuple[str, str, str, int]:
    """Return who has it, who asks, to whom it is offered, and how often it changed hands."""
    found = rover.description()
    return found.operator, found.wanted_by, found.offered_to, found.hands


async def test_who_has_control_commands_alone_and_everybody_stops(realm: Any, people: list[Person]) -> None:
    anna, ben, _ = people
    rover: Any = await realm.start(Rover("rover"))
    await ben.move()
    assert await anna.control("get") == anna.name
    assert shown(rover) == (anna.name, "", "", 1)
    with pytest.raises(HeldByOperator, match=rf"{anna.name} has control of rover; ask"):
        await ben.move()
    with pytest.raises(HeldByOperator):
        await ben.control("get")
    with sitting_at(ben.terminal):
        with pytest.raises(HeldByOperator):
            await ben.client.decide("rover", "done")
        assert (await ben.client.call("rover", "get_info", {}))["moves"] == 1, (
            "who only reads is in nobody's way"
        )
    await anna.move()
    await anna.control("leave")
    await ben.move()
    await anna.control("get")
    with sitting_at(ben.terminal):
        await ben.client.stop("rover")
    assert rover.description().stopped
    with sitting_at(anna.terminal):
        await anna.client.resume("rover")


async def test_it_is_asked_for_and_handed_over(realm: Any, people: list[Person]) -> None:
    anna, ben, carl = people
    rover: Any = await realm.start(Rover("rover"))
    for what in ("ask", "offer"):
        with pytest.raises(ControlRefused, match="nobody has control of it"):
            await ben.control(what)
    await anna.control("get")
    with pytest.raises(ControlRefused, match="nobody asks for it"):
        await anna.control("offer")
    await ben.control("ask")
    assert shown(rover)[:2] == (anna.name, ben.name)
    with pytest.raises(ControlRefused, match=rf"{ben.name} asks {anna.name} for it already, for \d+ s more"):
        await carl.control("ask")
    with pytest.raises(HeldByOperator):
        await ben.control("offer", person=ben.name)
    assert await anna.control("offer") == ben.name
    assert shown(rover) == (ben.name, "", "", 2)
    with pytest.raises(HeldByOperator):
        await anna.move()
    await ben.move()
    await ben.control("offer", person=carl.name)
    assert shown(rover) == (ben.name, "", carl.name, 2)
    with pytest.raises(HeldByOperator):
        await anna.control("get")
    assert await carl.control("get") == carl.name


async def test_a_question_and_an_offer_end_by_themselves(realm: Any, people: list[Person]) -> None:
    anna, ben, carl = people
    rover: Any = await realm.start(Rover("rover"))
    await anna.control("get")
    await ben.control("ask")
    await anna.control("offer", person=carl.name)
    waited = await realm.until(lambda: shown(rover)[1:3] == ("", ""))
    assert OPEN_FOR - 1 < waited < OPEN_FOR + 1
    with pytest.raises(HeldByOperator):
        await carl.control("get")
    await ben.control("ask")
    await ben.control("leave")
    assert shown(rover)[:2] == (anna.name, ""), "a question can be taken back"


async def test_who_takes_it_ends_what_the_other_one_began(realm: Any, people: list[Person]) -> None:
    anna, ben, _ = people
    rover: Any = await realm.start(Rover("rover"))
    await anna.control("get")
    with sitting_at(anna.terminal):
        going = asyncio.create_task(anna.client.call("rover", "move", {"x": 5}))
        await realm.until(lambda: rover.description().busy == "move")
    assert await ben.control("take", seen=1) == ben.name
    with pytest.raises(CommandCancelled, match=rf"{ben.name} has taken control of rover"):
        await going


async def test_of_two_takers_at_once_one_is_told_in_a_sentence(realm: Any, people: list[Person]) -> None:
    anna, ben, carl = people
    rover: Any = await realm.start(Rover("rover"))
    await anna.control("get")
    assert await ben.control("take", seen=1) == ben.name
    with pytest.raises(ControlRefused) as refused:
        await carl.control("take", seen=1)
    said = (
        f"control of rover stays as it is: {ben.name} got control of it a moment ago; look, and take it again"
    )
    assert str(refused.value) == said
    assert shown(rover) == (ben.name, "", "", 2)
    assert await carl.control("take", seen=2) == carl.name


async def test_who_vanishes_loses_what_was_theirs_and_nothing_else(realm: Any, people: list[Person]) -> None:
    anna, ben, carl = people
    rovers = [await realm.start(Rover(name)) for name in ("rover", "other")]
    await anna.control("get")
    await ben.control("get", "other")
    realm.network.kill(anna.transport)
    await realm.until(lambda: shown(rovers[0])[0] == "")
    assert shown(rovers[1])[0] == ben.name
    await carl.move()
    await carl.control("get")
    await ben.control("ask")
    realm.network.kill(carl.transport)
    await realm.until(lambda: shown(rovers[0])[0] == ben.name)
    realm.network.kill(ben.transport)
    await realm.until(lambda: [shown(each)[0] for each in rovers] == ["", ""])


async def test_it_can_be_had_for_a_time_without_a_program_that_stays(
    realm: Any, people: list[Person]
) -> None:
    anna, ben, _ = people
    rover: Any = await realm.start(Rover("rover"))
    await anna.control("get", within=60.0)
    realm.network.kill(anna.transport)
    waited = await realm.until(lambda: shown(rover)[0] == "", 100)
    assert 58 < waited < 61
    for wrong in (-1.0, float("inf"), float("nan")):
        with pytest.raises(ControlRefused, match="is none"):
            await ben.control("get", within=wrong)
    await ben.control("get", within=10 * LONGEST)
    state: RobotState = rover.runtime.core.state
    assert state.control.due < realm.runner.now() + LONGEST + 1


async def test_a_robot_under_a_parent_and_one_that_is_held_do_not_mix(
    realm: Any, people: list[Person]
) -> None:
    anna, _, _ = people
    _, rover = await crew(realm)
    with pytest.raises(NotInControl):
        await anna.control("get", rover.robot.name)
    await anna.control("get", "driver")
    with pytest.raises(HeldByOperator), sitting_at(people[1].terminal):
        await people[1].client.call("driver", "square", {"length": 0.1})
    spare = await realm.start(Rover("spare"))
    await anna.control("get", "spare")
    with pytest.raises(VrError, match="gives it up"):
        await realm.client(await realm.start(Driver("other"))).enslave("left", spare.address)
    assert rover.description().bond is not None


async def test_guests_watch_and_who_may_not_take_asks(realm: Any, people: list[Person]) -> None:
    anna, ben, _ = people
    gate = realm.network.gate = PolicyGate()
    await realm.start(Rover("rover"))
    gate.policy = read_policy(
        f"realm: test\nversion: 1\npersons: {{'{ME}': operator}}\n"
        "roles: {operator: {see: '*', command: '*'}, chief: {see: '*', command: '*', take: '*'}}\n"
    )
    await anna.control("get")
    with pytest.raises(Denied, match="take"):
        await ben.control("take")
    await ben.control("ask")
    gate.policy = read_policy(
        f"realm: test\nversion: 2\npersons: {{'{ME}': guest}}\nroles: {{guest: {{see: '*'}}}}\n"
    )
    for what in ("get", "ask", "offer", "take"):
        with pytest.raises(Denied):
            await ben.control(what)
    await anna.control("leave")


async def test_a_robot_that_comes_back_knows_who_had_control(realm: Any, people: list[Person]) -> None:
    anna, _, _ = people
    rover: Any = await realm.start(Rover("rover"))
    await anna.control("get")
    state: RobotState = rover.runtime.core.state
    kept = decode_state(encode_state(state))
    assert kept.control == state.control
    assert (kept.control.holder.person, kept.control.hands) == (anna.name, 1)
