"""A command ends with the program that has called it, and one that is attended 2 s after the last key."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.callers import LINGER
from robotree.vr.base.errors import CommandCancelled, NobodyAttends, VrError
from robotree.vr.base.presence import Presence
from robotree.vr.base.requests import Attend, Call, Done
from robotree.vr.core.machine import ATTENTION, UNATTENDED
from robotree.vr.exchange.asking import ask, fresh_key
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryTransport
from tests.vr.core.crew import Rover, crew

STEP = 0.05


class Person:
    """A person at a terminal of their own, who calls commands and presses keys."""

    def __init__(self, realm: Any) -> None:
        self.realm = realm
        self.transport: MemoryTransport = realm.network.join("shell")
        self.client = RealmClient(self.transport)
        self.keys = Attendance()
        self.calls: list[asyncio.Task[Any]] = []

    def call(self, name: str, command: str, **arguments: float) -> None:
        self.calls.append(asyncio.create_task(self.client.call(name, command, arguments)))

    def attend(self, name: str, command: str) -> asyncio.Task[Any]:
        call = asyncio.create_task(self.client.call(name, command, {}, attendance=self.keys))
        self.calls.append(call)
        return call

    async def hold(self, seconds: float) -> None:
        """Hold a key, as a terminal repeats it."""
        for _ in range(round(seconds / STEP)):
            self.keys.press()
            await asyncio.sleep(STEP)

    async def moves(self) -> Any:
        """Have a rover move, and return it."""
        rover = await self.realm.start(Rover("rover"))
        self.call("rover", "move", x=5)
        await self.realm.until(lambda: running(rover) == ["move"])
        return rover

    def kill(self) -> None:
        self.realm.network.kill(self.transport)


@pytest.fixture
async def person(realm: Any) -> AsyncIterator[Person]:
    person = Person(realm)
    await person.client.start()
    yield person
    for call in person.calls:
        call.cancel()
    await asyncio.gather(*person.calls, return_exceptions=True)
    await person.client.close()


def running(*agents: Any) -> list[str]:
    return [agent.description().busy for agent in agents]


async def test_a_killed_caller_ends_its_command_down_to_the_hardware(realm: Any, person: Person) -> None:
    driver, rover = await crew(realm)
    person.call("driver", "square", length=5)
    await realm.until(lambda: running(driver, rover) == ["square", "move"])
    person.kill()
    assert await realm.until(lambda: running(driver, rover) == ["", ""]) < 0.2
    assert rover.robot.x < 1
    await realm.client(driver).call("drive", {"x": 0.1})  # the next one may move it


async def test_a_stopped_caller_ends_its_command_when_its_presence_is_over(
    realm: Any, person: Person
) -> None:
    rover = await person.moves()
    realm.network.freeze(person.transport)
    assert 1.9 < await realm.until(lambda: running(rover) == [""]) < 2.2
    realm.network.thaw(person.transport)
    (error,) = await asyncio.gather(*person.calls, return_exceptions=True)
    assert "in the middle" in str(error) or isinstance(error, CommandCancelled)


async def test_what_waits_ends_with_its_caller_and_what_others_have_called_goes_on(
    realm: Any, person: Person
) -> None:
    rover = await realm.start(Rover("rover"))
    other = asyncio.create_task(realm.client(rover).call("move", {"x": 3}))
    await realm.until(lambda: running(rover) == ["move"])
    person.call("rover", "move", x=5)
    await realm.until(lambda: rover.description().waiting == 1)
    person.kill()
    await realm.until(lambda: rover.description().waiting == 0, within=0.2)
    await other
    assert rover.robot.x == pytest.approx(3)


async def test_a_command_that_was_only_told_goes_on_without_its_caller(realm: Any, person: Person) -> None:
    rover = await realm.start(Rover("rover"))
    await person.client.tell("rover", "move", {"x": 3})
    person.kill()
    await realm.until(lambda: running(rover) == [""])
    assert rover.robot.x == pytest.approx(3)


async def test_a_caller_that_calls_again_and_again_is_watched_once_and_still_guarded(
    realm: Any, person: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover = await realm.start(Rover("rover"))
    begun: list[str] = []
    watch = Presence.watch

    def counted(self: Presence, key: str, handler: Any) -> Any:
        begun.extend([key] if key.startswith("caller/") else [])
        return watch(self, key, handler)

    monkeypatch.setattr(Presence, "watch", counted)
    for _ in range(5):
        await person.client.call("rover", "move", {"x": 0.01})
    assert len(begun) == 1
    await asyncio.sleep(2 * LINGER + 1)  # then it is forgotten
    person.call("rover", "move", x=5)
    await realm.until(lambda: running(rover) == ["move"])
    assert len(begun) == 2
    person.kill()
    await realm.until(lambda: running(rover) == [""], within=0.2)


async def test_a_caller_that_was_never_there_is_not_obeyed_for_long(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    client = RobotClient(realm.operator, rover.address)
    with pytest.raises(CommandCancelled, match="its caller has gone"):
        await client.call("move", {"x": 5}, sender="caller/nobody")
    assert rover.robot.x < 1


async def test_a_caller_that_closes_in_order_leaves_nothing_running(realm: Any, person: Person) -> None:
    rover = await person.moves()
    await person.client.close()
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
    realm: Any, person: Person, caplog: pytest.LogCaptureFixture
) -> None:
    rover = await realm.start(Rover("rover"))
    await person.client.tell("rover", "move", {"x": 5})
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
    await realm.until(lambda: bool(person.client.directory.present("robot")))
    await person.client.call("rover", "move", {"x": 0.1})


async def test_a_robot_that_others_can_find_goes_on_alone(realm: Any, person: Person) -> None:
    rover = await realm.start(Rover("rover"))
    await person.client.tell("rover", "move", {"x": 3})
    await realm.until(lambda: running(rover) == ["move"])
    for other in list(realm.network.members):
        if other is not rover.transport:
            realm.network.cut(rover.transport, other)
    await realm.until(lambda: running(rover) == [""])
    assert rover.robot.x == pytest.approx(3)


# -- attended commands, whoever is between key and robot -------------------------------------------


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
    task = person.attend(top.robot.name, ("turn", "cut", "cut")[tops])
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
    person.attend(top.robot.name, ("turn", "cut")[tops])
    await person.hold(3.0)
    realm.network.freeze(person.transport)
    assert await realm.until(lambda: saw.description().busy == "") < ATTENTION + 0.3
    realm.network.thaw(person.transport)


async def test_a_parent_that_is_stopped_passes_nothing_on(realm: Any, person: Person) -> None:
    saw, top = await tree(realm, 1)
    person.attend("joiner", "cut")
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
    person.calls.append(asyncio.create_task(caller.carry_out(call)))
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
    person.attend("saw", "turn")
    await realm.until(lambda: saw.description().busy == "turn")
    assert await realm.until(lambda: saw.description().busy == "") < ATTENTION + 0.2


async def test_what_cannot_be_attended_is_refused_where_it_is_written() -> None:
    with pytest.raises(TypeError, match="only reads"):
        command(effect="read", attended=True)
    with pytest.raises(TypeError, match="order"):
        command(offline="queue", attended=True)
