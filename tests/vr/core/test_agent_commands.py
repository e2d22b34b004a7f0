"""One robot, its commands, and callers of all kinds."""

from __future__ import annotations

import asyncio
import math
from typing import Annotated, Any

import pytest

from robotree.vr import Range, Robot, Unit, VrError, command
from robotree.vr.base.envelope import seal
from robotree.vr.base.errors import (
    BadArgument,
    Busy,
    CommandFailed,
    DeadlineExceeded,
    DuplicateName,
    Garbled,
    KeyReused,
    NoSuchCommand,
    NotBegun,
    NotVirtual,
)
from robotree.vr.base.requests import DescribeHost, Raised, decode_reply
from robotree.vr.core.machine import LONGEST_QUEUE, MOST_READERS
from robotree.vr.exchange.asking import fresh_key
from robotree.vr.exchange.client import RobotClient
from tests.vr.core.crew import Where


class Rover(Robot):
    """A rover that remembers what it did."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.x = 0.0
        self.done: list[str] = []

    @command
    def move(self, x: Annotated[float, Unit("m"), Range(-10, 10)]) -> None:
        """Move ahead, one metre per second."""
        for step in range(10):
            self.sleep(abs(x) / 10)
            self.progress((step + 1) / 10, "rolling")
        self.x += x
        self.done.append(f"move {x:g}")

    @command(effect="read")
    def get_info(self) -> Where:
        return Where(self.x, len(self.done))

    @command
    def papers(self) -> Any:
        return {
            "key": self.context.key,
            "caller": self.context.caller,
            "deadline_at": self.context.deadline_at,
        }

    @command
    def stumble(self) -> None:
        raise ZeroDivisionError("a stone")

    @command
    def doze(self) -> None:
        self.sleep(math.nan)

    @command
    def babble(self) -> Any:
        return object()


@pytest.fixture
async def rover(realm: Any) -> Any:
    return await realm.start(Rover("rover"))


async def test_a_command_is_carried_out_and_its_result_returned(realm: Any, rover: Any) -> None:
    client = realm.client(rover)
    assert await client.call("move", {"x": 2}) is None
    assert await client.call("move", {"x": "-50 cm"}) is None
    assert await client.call("get_info", {}) == {"x": 1.5, "moves": 2}


async def test_one_command_at_a_time_in_their_order(realm: Any, rover: Any) -> None:
    began = realm.runner.now()
    calls = [asyncio.create_task(realm.client(rover).call("move", {"x": x})) for x in (3, 1, 2)]
    await asyncio.gather(*calls)
    assert rover.robot.done == ["move 3", "move 1", "move 2"]
    assert realm.runner.now() - began >= 6.0


async def test_a_full_queue_refuses_and_loses_nothing(realm: Any, rover: Any) -> None:
    calls = [
        asyncio.create_task(realm.client(rover).call("move", {"x": 1})) for _ in range(LONGEST_QUEUE + 2)
    ]
    results = await asyncio.gather(*calls, return_exceptions=True)
    assert [type(result) for result in results if result is not None] == [Busy]
    assert len(rover.robot.done) == LONGEST_QUEUE + 1


@pytest.mark.parametrize(
    ("name", "arguments", "error", "sentence"),
    [
        ("doze", {}, CommandFailed, "rover.doze failed: ValueError: cannot sleep for NaN seconds"),
        ("fly", {}, NoSuchCommand, "rover has no command 'fly'; it has: move, get_info"),
        ("name", {}, NoSuchCommand, "rover has no command 'name'"),
        ("move", {"x": "10 kg"}, BadArgument, "rover.move: x: kg cannot be turned into m"),
        (
            "stumble",
            {},
            CommandFailed,
            "rover.stumble failed: ZeroDivisionError: a stone (test_agent_commands.py, line ",
        ),
        (
            "babble",
            {},
            CommandFailed,
            "rover.babble failed: TypeError: the result cannot travel: object is neither",
        ),
    ],
)
async def test_what_cannot_be_done_is_said_in_one_sentence(
    realm: Any, name: str, arguments: dict[str, Any], error: type[VrError], sentence: str, rover: Any
) -> None:
    with pytest.raises(error) as refused:
        await realm.client(rover).call(name, arguments)
    assert str(refused.value).startswith(sentence)
    assert rover.robot.done == []
    await realm.client(rover).call("move", {"x": 1})  # nothing is lost


async def test_what_waited_until_its_time_was_over_says_that_it_never_began(realm: Any, rover: Any) -> None:
    ahead = asyncio.create_task(realm.client(rover).call("move", {"x": 10}, deadline=9.0))
    await realm.until(lambda: rover.description().busy == "move")
    with pytest.raises(NotBegun, match=r"rover\.move did not begin within 1 s: move was under way"):
        await realm.client(rover).call("move", {"x": 9}, deadline=1.0)
    await realm.client(rover).cancel()
    await asyncio.gather(ahead, return_exceptions=True)


@pytest.mark.parametrize("deadline", [0.0, -1.0, math.nan, math.inf])
async def test_a_deadline_is_a_positive_time(realm: Any, deadline: float, rover: Any) -> None:
    call = realm.client(rover).call("move", {"x": 1}, deadline=deadline)
    with pytest.raises(DeadlineExceeded):
        await call


async def test_the_same_call_twice_is_carried_out_once_and_answered_twice(realm: Any, rover: Any) -> None:
    key = fresh_key()
    calls = [realm.client(rover).call("move", {"x": 1}, key=key) for _ in range(3)]
    assert await asyncio.gather(*calls) == [None, None, None]
    assert await realm.client(rover).call("move", {"x": 1}, key=key) is None  # replayed
    assert rover.robot.done == ["move 1"]
    with pytest.raises(KeyReused):
        await realm.client(rover).call("move", {"x": 2}, key=key)


async def test_a_caller_that_goes_away_ends_its_command(realm: Any, rover: Any) -> None:
    call = asyncio.create_task(realm.client(rover).call("move", {"x": 10}))
    await realm.until(lambda: rover.description().busy == "move")
    call.cancel()
    await realm.until(lambda: rover.description().busy == "", within=3.0)
    assert rover.robot.done == []


async def test_a_call_that_comes_after_its_caller_gave_up_is_not_carried_out(realm: Any, rover: Any) -> None:
    """The robot's process was stopped; when it goes on, it finds the call and the cancel."""
    realm.network.lease = 100.0
    realm.network.freeze(rover.transport)
    client = realm.client(rover, patience=1.0)
    refused = await asyncio.gather(client.call("move", {"x": 1}), return_exceptions=True)
    assert "did not answer within 1 s" in str(refused[0])
    realm.network.thaw(rover.transport)
    await asyncio.sleep(5.0)
    assert rover.robot.done == []


async def test_a_command_knows_its_papers(realm: Any, rover: Any) -> None:
    papers = await realm.client(rover).call("papers", {}, deadline=30.0, caller="ahmad", key="k")
    assert (papers["key"], papers["caller"]) == ("k", "ahmad")
    assert papers["deadline_at"] == pytest.approx(realm.runner.now() + 30.0, abs=0.5)


async def test_a_robot_that_has_children_by_nature_alone_can_be_deleted_or_bound(realm: Any) -> None:
    rover, other = await realm.start(Rover("rover")), await realm.start(Rover("other"))
    for question in (
        realm.client(rover).delete(),
        realm.client(rover).free("arm"),
        realm.client(rover).enslave("arm", other.address),
    ):
        with pytest.raises(NotVirtual):
            await question


async def test_garbage_and_questions_to_others_are_answered_with_an_error(realm: Any, rover: Any) -> None:
    of_a_host = seal(DescribeHost(), now=realm.runner.now(), within=5.0).body
    for body in (b"\xff\x00garbage", b"", of_a_host):
        replies = [reply async for reply in realm.operator.request(rover.address.key, body, timeout=5.0)]
        failed = decode_reply(replies[0], key="rover")
        assert isinstance(failed, Raised)
        assert isinstance(failed.revive(), Garbled)


async def test_a_robot_that_ends_in_the_middle_says_so_to_its_caller(realm: Any, rover: Any) -> None:
    call = asyncio.create_task(realm.client(rover).call("move", {"x": 10}))
    await realm.until(lambda: rover.description().busy == "move")
    realm.kill(rover)
    with pytest.raises(CommandFailed, match="it ended in the middle; look where the robot stands"):
        await call


async def test_a_dead_robot_is_unreachable(realm: Any, rover: Any) -> None:
    client: RobotClient = realm.client(rover)
    realm.kill(rover)
    for question in (client.call("move", {"x": 1}), client.describe(), client.safe_stop()):
        with pytest.raises(VrError, match="nobody answers at robot/rover/"):
            await question


class Meter(Robot):
    """Reads, and takes its time."""

    @command(effect="read")
    def read(self) -> None:
        self.sleep(1.0)


async def test_a_second_robot_of_the_same_name_is_refused(realm: Any) -> None:
    await realm.start(Rover("rover"))
    with pytest.raises(DuplicateName, match="a robot named 'rover' is already running"):
        await realm.start(Rover("rover"))
    await realm.start(Rover("rover-2"))


async def test_who_reads_too_much_hears_how_many_read(realm: Any) -> None:
    meter = await realm.start(Meter("meter"))
    reading = [asyncio.create_task(realm.client(meter).call("read", {})) for _ in range(MOST_READERS)]
    await realm.until(lambda: len(meter.runtime.runs) == MOST_READERS)
    with pytest.raises(Busy, match=r"32 that only read run already; wait, or .*`robotree cancel meter`"):
        await realm.client(meter).call("read", {})
    await asyncio.gather(*reading)
