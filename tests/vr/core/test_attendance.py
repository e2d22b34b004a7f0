"""A command that wants somebody at a key ends 2 s after the last one, whoever is between key and robot."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.base.errors import CommandCancelled, NobodyAttends, VrError
from robotree.vr.base.requests import Attend, Call, Done
from robotree.vr.core.machine import ATTENTION, UNATTENDED
from robotree.vr.exchange.asking import ask, fresh_key
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.realm_client import RealmClient

STEP = 0.05


class Saw(Robot):
    """A saw."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.turned = 0
        self.cleaned = False

    @command(attended=True)
    def turn(self) -> None:
        """Turn for ever."""
        while True:
            self.sleep(STEP)
            self.turned += 1

    @command
    def blow(self) -> None:
        """Blow dust away."""
        self.cleaned = True


class Joiner(VirtualRobot):
    """Has a saw turn."""

    saw = Child("Saw")

    @command(attended=True)
    def cut(self) -> None:
        try:
            self.saw.turn()
        finally:
            self.saw.blow()

    @command
    def careless(self) -> None:
        self.saw.turn()


class Foreman(VirtualRobot):
    """One more above."""

    joiner = Child("Joiner")
    cut = joiner.exposed("cut")


class Person:
    """A person at a terminal of their own, who presses keys."""

    def __init__(self, realm: Any) -> None:
        self.realm, self.transport = realm, realm.network.join("screen")
        self.client = RealmClient(self.transport)
        self.keys = Attendance()
        self.tasks: list[asyncio.Task[Any]] = []

    def begin(self, name: str, command: str) -> asyncio.Task[Any]:
        task = asyncio.create_task(self.client.call(name, command, {}, attendance=self.keys))
        self.tasks.append(task)
        return task

    async def hold(self, seconds: float) -> None:
        """Hold a key, as a terminal repeats it."""
        for _ in range(round(seconds / STEP)):
            self.keys.press()
            await asyncio.sleep(STEP)


@pytest.fixture
async def person(realm: Any) -> AsyncIterator[Person]:
    found = Person(realm)
    await found.client.start()
    yield found
    for task in found.tasks:
        task.cancel()
    await asyncio.gather(*found.tasks, return_exceptions=True)
    await found.client.close()


async def tree(realm: Any, tops: int) -> Any:
    """Start a saw, and robots above it."""
    saw = top = await realm.start(Saw("saw"))
    for made in (Joiner("joiner"), Foreman("foreman"))[:tops]:
        above = await realm.start(made)
        slot = "saw" if made.name == "joiner" else "joiner"
        await realm.client(above).enslave(slot, top.address)
        top = above
    return saw, top


@pytest.mark.parametrize("tops", [0, 1, 2])
async def test_it_goes_on_while_a_key_is_held_and_ends_two_seconds_after_the_last(
    homes: Any, person: Person, tops: int
) -> None:
    realm = homes
    saw, top = await tree(realm, tops)
    task = person.begin(top.robot.name, ("turn", "cut", "cut")[tops])
    await person.hold(7.0)
    assert saw.robot.turned > 100, "through each level"
    assert not task.done()
    waited = await realm.until(lambda: saw.description().busy == "")
    assert ATTENTION - 0.3 < waited < ATTENTION + 0.2
    with pytest.raises(CommandCancelled, match=UNATTENDED):
        await task
    assert not saw.robot.cleaned, "nobody attends a clean-up that moves"
    before = saw.robot.turned
    await person.hold(1.0)
    assert saw.robot.turned == before, "a key that comes too late begins nothing"


@pytest.mark.parametrize("tops", [0, 1])
async def test_a_program_that_is_stopped_or_killed_attends_nothing(
    realm: Any, person: Person, tops: int
) -> None:
    saw, top = await tree(realm, tops)
    person.begin(top.robot.name, ("turn", "cut")[tops])
    await person.hold(3.0)
    realm.network.freeze(person.transport)
    assert await realm.until(lambda: saw.description().busy == "") < ATTENTION + 0.3
    realm.network.thaw(person.transport)


async def test_a_parent_that_is_stopped_passes_nothing_on(realm: Any, person: Person) -> None:
    saw, top = await tree(realm, 1)
    person.begin("joiner", "cut")
    await person.hold(3.0)
    realm.network.freeze(top.transport)
    holding = asyncio.create_task(person.hold(5.0))
    assert await realm.until(lambda: saw.description().busy == "") < ATTENTION + 0.3
    realm.network.thaw(top.transport)
    await holding


async def test_without_anybody_at_a_key_it_does_not_begin(realm: Any, person: Person) -> None:
    saw, _ = await tree(realm, 0)
    with pytest.raises(NobodyAttends, match="at a terminal"):
        await person.client.call("saw", "turn", {})
    with pytest.raises(NobodyAttends):
        await person.client.tell("saw", "turn", {})
    assert saw.robot.turned == 0


async def test_a_command_that_is_not_attended_has_no_attended_one_carried_out(
    realm: Any, person: Person
) -> None:
    saw, _ = await tree(realm, 1)
    with pytest.raises(Exception, match="holds a key, and joiner holds none"):
        await person.client.call("joiner", "careless", {}, attendance=person.keys)
    assert saw.robot.turned == 0


async def turning(realm: Any, person: Person) -> tuple[Any, str]:
    """Return a saw that turns for a program, and the key of the call."""
    saw, _ = await tree(realm, 0)
    call = Call(key=fresh_key(), command="turn", deadline=60.0, attended=ATTENTION)
    await person.transport.announce("caller/one")
    caller = RobotClient(person.transport, saw.address, sender="caller/one")
    person.tasks.append(asyncio.create_task(caller.carry_out(call)))
    await realm.until(lambda: saw.description().busy == "turn")
    return saw, call.key


async def test_the_key_of_somebody_else_does_not_count(realm: Any, person: Person) -> None:
    saw, key = await turning(realm, person)
    other = RobotClient(realm.network.join("other"), saw.address, sender="caller/two")
    for _ in range(60):
        other.press(key)
        await asyncio.sleep(STEP)
    assert saw.description().busy == "", "it has ended though the other presses"


@pytest.mark.parametrize("age", [math.nan, -math.inf, -60.0])
async def test_a_key_of_no_age_prolongs_nothing(realm: Any, person: Person, age: float) -> None:
    saw, key = await turning(realm, person)
    request = Attend(key=key, age=age)
    with contextlib.suppress(VrError):
        await ask(person.transport, saw.address.key, request, Done, timeout=1.0, sender="caller/one")
    assert await realm.until(lambda: saw.description().busy == "") < ATTENTION + 0.2


async def test_a_call_cannot_say_that_it_is_attended_for_longer(realm: Any, person: Person) -> None:
    saw, _ = await tree(realm, 0)
    person.keys = Attendance(until=1000.0)
    person.begin("saw", "turn")
    await realm.until(lambda: saw.description().busy == "turn")
    assert await realm.until(lambda: saw.description().busy == "") < ATTENTION + 0.2


async def test_what_cannot_be_attended_is_refused_where_it_is_written() -> None:
    with pytest.raises(TypeError, match="only reads"):
        command(effect="read", attended=True)
    with pytest.raises(TypeError, match="order"):
        command(offline="queue", attended=True)
