"""What was given up does not begin when the process that hung reads what lies in its socket."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.errors import NoAnswer, Unreachable, VrError
from robotree.vr.exchange import timely
from robotree.vr.exchange.client import RobotClient
from robotree.vr.exchange.timely import FRESH, opened
from robotree.vr.requests import Call, Raised, Reply, Request, Timely, decode_reply, decode_request
from tests.vr.recorder import Recorder

LEASE = 2.0
"""[s] of silence after which the network lets a member go."""


class Rover(Robot):
    """Counts what it does."""

    moves = 0

    @command
    def move(self) -> int:
        self.moves += 1
        return self.moves


class Carrier(VirtualRobot):
    rover = Child("Rover")


async def read(agent: RobotAgent, body: bytes) -> list[Reply]:
    """Let an agent find a request in its socket."""
    transport: Any = agent.transport
    answers: list[bytes] = []
    await transport.served[agent.address.key](body, answers.append)
    return [decode_reply(answer, key="it") for answer in answers]


@pytest.fixture
def asker(realm: Any) -> Recorder:
    return Recorder(realm.operator)


@pytest.mark.parametrize("hung_for", [0.0, 1.0, LEASE - 0.01])
@pytest.mark.parametrize("what", ["call", "tell", "resume", "enslave", "free", "delete"])
async def test_what_was_asked_of_a_process_that_hangs_never_begins_after_its_asker_gave_up(
    realm: Any, asker: Any, what: str, hung_for: float
) -> None:
    robot = await realm.start(Carrier("carrier") if what in {"enslave", "free", "delete"} else Rover("rover"))
    client = RobotClient(asker, robot.address)
    questions = {
        "call": lambda: client.call("move", {}),
        "tell": lambda: client.tell("move", {}),
        "resume": client.resume,
        "enslave": lambda: client.enslave("rover", robot.address),
        "free": lambda: client.free("rover"),
        "delete": client.delete,
    }
    await client.safe_stop("so")
    realm.network.freeze(robot.transport)
    await asyncio.sleep(hung_for)
    asker.sent.clear()
    with pytest.raises((Unreachable, NoAnswer)):
        await questions[what]()
    answers = await read(robot, asker.sent[0])
    realm.network.thaw(robot.transport)
    assert [type(answer) for answer in answers] == [Raised]
    assert isinstance(answers[0], Raised)
    assert isinstance(answers[0].revive(), NoAnswer)
    assert robot.description().stopped
    assert not robot.closed.is_set()


async def test_a_stop_is_obeyed_however_late_it_comes(realm: Any, asker: Any) -> None:
    rover = await realm.start(Rover("rover"))
    realm.network.freeze(rover.transport)
    with pytest.raises(VrError):
        await RobotClient(asker, rover.address).safe_stop("so")
    await asyncio.sleep(60)
    await read(rover, asker.sent[0])
    realm.network.thaw(rover.transport)
    assert rover.description().stopped


async def test_nobody_waits_longer_for_who_has_ended(realm: Any, asker: Any) -> None:
    rover = await realm.start(Rover("rover"))
    realm.kill(rover)
    began = asyncio.get_running_loop().time()
    with pytest.raises(Unreachable):
        await RobotClient(asker, rover.address).call("move", {})
    assert asyncio.get_running_loop().time() - began < 0.1


async def test_on_another_machine_a_request_is_as_new_as_its_arrival(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    call = Call(key="k", command="move", deadline=5.0)
    now = asyncio.get_running_loop().time()

    def asked(seconds_ago: float, boot: str) -> Request:
        return opened(
            Timely(request=call, asked=now - seconds_ago, holds=FRESH, boot=boot),
            "rover",
            now,
            timely.boot_here(),
        )

    assert asked(FRESH - 0.1, timely.boot_here()) == call
    with pytest.raises(NoAnswer):
        asked(FRESH, timely.boot_here())
    assert asked(1000.0, "another") == call
    assert opened(call, "rover", now, "") == call
    monkeypatch.setattr(timely, "boot_here", lambda: "")  # a system that does not tell it
    assert decode_request(timely.Question(call, within=5.0).body) == call
