"""How many messages a call between two processes takes, and when what was sent may have begun."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from typing import Annotated, Any, cast

import pint
import pytest

from robotree.vr import Child, Robot, Unit, VirtualRobot, VrError, command
from robotree.vr.agents.outside import ACCEPTED_WITHIN
from robotree.vr.base.errors import CommandFailed, Unreachable
from robotree.vr.base.requests import Call, Progress, decode_reply
from robotree.vr.base.units import SCALES, convert
from robotree.vr.exchange.client import RobotClient
from robotree.vr.running.child_call import ChildCall
from robotree.vr.running.robot_runtime import RobotRuntime
from tests.vr.core.crew import Rover


class Meter(Robot):
    """Measures."""

    @command(effect="read")
    def look(self, seconds: float = 0.0) -> int:
        """Look for a while."""
        self.sleep(seconds)
        return 1

    @command(effect="read")
    def fail(self) -> int:
        """Fail."""
        raise CommandFailed(robot="meter", command="fail", detail="the lens is dirty")

    @command(effect="read")
    def height(self) -> Annotated[float, Unit("mm")]:
        """Measure."""
        return 2.0

    @command
    def move(self, x: Annotated[float, Unit("m")] = 0.0) -> float:
        """Move."""
        return x


@pytest.fixture
def replies(realm: Any) -> list[str]:
    """The names of the replies that the operator gets."""
    heard: list[str] = []

    def note(_source: str, target: str, kind: str, _key: str, body: bytes) -> None:
        if kind == "reply" and target == "operator":
            heard.append(type(decode_reply(body, key="it")).__name__)

    realm.network.on_message = note
    return heard


async def test_a_command_that_only_reads_and_ends_at_once_is_answered_with_one_message(
    realm: Any, replies: list[str]
) -> None:
    meter = realm.client(await realm.start(Meter("meter")))
    assert await meter.call("look", {}) == 1
    assert replies == ["Returned"]
    replies.clear()
    assert await meter.call("move", {"x": 1}) == 1.0
    assert replies == ["Accepted", "Returned"]


async def test_a_command_that_reads_for_long_is_accepted_in_time(realm: Any, replies: list[str]) -> None:
    meter = RobotClient(realm.operator, (await realm.start(Meter("meter"))).address, patience=1.0)
    looking = [asyncio.create_task(meter.call("look", {"seconds": 30.0})) for _ in range(3)]
    await asyncio.sleep(2 * ACCEPTED_WITHIN)
    assert replies == ["Accepted"] * 3
    assert await asyncio.gather(*looking) == [1, 1, 1]
    assert await meter.call("look", {"seconds": 30.0}) == 1


async def test_an_error_of_a_command_that_reads_is_no_refusal(realm: Any, replies: list[str]) -> None:
    meter = realm.client(await realm.start(Meter("meter")))
    with pytest.raises(CommandFailed, match="lens") as failed:
        await meter.call("fail", {})
    assert failed.value.entered
    assert replies == ["Accepted", "Raised"]


async def test_a_robot_that_dies_while_it_reads_is_unreachable(realm: Any) -> None:
    meter = await realm.start(Meter("meter"))
    looking = asyncio.create_task(realm.client(meter).call("look", {"seconds": 30.0}))
    await asyncio.sleep(ACCEPTED_WITHIN / 2)
    realm.kill(meter)
    with pytest.raises(Unreachable):
        await looking


async def test_a_number_that_comes_as_text_starts_no_thread(realm: Any) -> None:
    agent = await realm.start(Meter("meter"))
    agent._outside._units.submit = None
    for text in ("0.3", " 0.3 m", "3e-1"):
        assert await realm.client(agent).call("move", {"x": text}) == 0.3


def test_only_a_unit_that_is_not_usual_has_to_be_loaded() -> None:
    code = (
        "import sys; from robotree.vr.base.units import takes_long, read_quantity as read; "
        "assert not any(takes_long(text, 'm') for text in ('1', '1 m', '1 cm', 'red', '9' * 99 + ' ft')); "
        "assert read('1 cm', 'm') == 0.01 and takes_long('1 ft', 'm') and takes_long('1 s', 'm'); "
        "assert 'pint' not in sys.modules; "
        "assert abs(read('1 ft', 'm') - 0.3048) < 1e-9 and not takes_long('1 ft', 'm')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


REGISTRY = cast("Any", pint.UnitRegistry())


@pytest.mark.parametrize("given", SCALES)
def test_a_usual_unit_means_what_pint_says(given: str) -> None:
    for wanted in SCALES:
        if SCALES[given][0] != SCALES[wanted][0]:
            with pytest.raises(ValueError, match="cannot be turned into"):
                convert(1.0, given, wanted)
            continue
        for number in (1.0, 0.37, 55.0, -12.5):
            meant = REGISTRY.Quantity(number, given).to(wanted).magnitude
            assert convert(number, given, wanted) == pytest.approx(meant, rel=1e-15)


async def test_what_a_result_is_comes_with_it_to_a_caller_that_asks(realm: Any, replies: list[str]) -> None:
    meter = realm.client(await realm.start(Meter("meter")))
    fields: list[Any] = []
    call = Call(key="1/look", command="height", deadline=5.0, describe_result=True)
    assert await meter.carry_out(call, on_fields=fields.extend) == 2.0
    assert [field.unit for field in fields] == ["mm"]
    assert replies == ["Returned"]


# -- a parent's call: what ends at once takes one message; else it may have begun ------------------


A_WHILE = 1.0


class Asker(VirtualRobot):
    """Calls its child and says what came of it."""

    left = Child("Rover")

    @command
    def ask(self, x: float) -> str:
        """Have the child move."""
        try:
            self.left.move(x=x)
        except VrError as error:
            return type(error).__name__
        return "moved"

    @command
    def look(self) -> str:
        """Have the child look, which changes nothing."""
        try:
            self.left.get_info()
        except VrError as error:
            return type(error).__name__
        return "looked"

    @command
    def send(self) -> None:
        """Have the child move and go on after this."""
        self.left.move.start(x=1).detach()


@pytest.fixture
def replies_below(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the calls of children in other processes are answered with, without progress."""
    found: list[str] = []
    take = ChildCall.take_reply

    def noted(call: ChildCall, reply: Any) -> None:
        if reply is not None and not isinstance(reply, Progress):
            found.append(type(reply).__name__)
        take(call, reply)

    monkeypatch.setattr(ChildCall, "take_reply", noted)
    return found


async def test_what_ends_at_once_is_answered_with_one_message(realm: Any, replies_below: list[str]) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    assert await realm.client(asker).call("look", {}) == "looked"
    assert replies_below == ["Returned"]


async def test_what_takes_longer_is_accepted_first(realm: Any, replies_below: list[str]) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    assert await realm.client(asker).call("ask", {"x": A_WHILE}) == "moved"
    assert replies_below == ["Accepted", "Returned"]


async def test_what_is_to_go_on_alone_waits_until_the_child_has_it(
    realm: Any, replies_below: list[str]
) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    await realm.client(asker).call("send", {})
    assert replies_below == ["Accepted"]
    await realm.until(lambda: asker.left.robot.x == pytest.approx(1))


async def test_a_motion_whose_robot_dies_before_it_says_anything_may_have_begun(
    realm: Any, replies_below: list[str]
) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    rover = asker.left
    realm.runner.at(realm.runner.now() + 0.02, lambda: realm.kill(rover))
    assert await realm.client(asker).call("ask", {"x": A_WHILE}) in {"CommandInDoubt", "SlotEmpty"}
    assert replies_below == []
    assert rover.robot.keys, "it had begun"


@pytest.mark.parametrize(
    ("command", "after", "error"),
    [
        ("ask", 0.02, "CommandInDoubt"),
        ("ask", 0.0, "Unreachable"),  # nobody serves the key: nothing has left
        ("look", 0.02, "Unreachable"),  # to ask again changes nothing
    ],
)
async def test_what_is_lost_on_its_way_is_in_doubt_if_it_moves(
    realm: Any, monkeypatch: pytest.MonkeyPatch, command: str, after: float, error: str
) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    ask = RobotRuntime.ask

    def lost(runtime: RobotRuntime, key: str, request: Any, on_reply: Any, **options: Any) -> None:
        if not isinstance(request, Call):
            ask(runtime, key, request, on_reply, **options)
        elif after:
            realm.runner.at(realm.runner.now() + after, lambda: on_reply(None))
        else:
            on_reply(None)

    monkeypatch.setattr(RobotRuntime, "ask", lost)
    given = {"x": A_WHILE} if command == "ask" else {}
    assert await realm.client(asker).call(command, given) == error
