"""An expired request does not begin when the process that hung reads its socket."""

from __future__ import annotations

import asyncio
import math
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base import envelope
from robotree.vr.base import requests as req
from robotree.vr.base.envelope import BEGINS, ENDS, FRESH, on_clock, opened, seal
from robotree.vr.base.errors import Garbled, NoAnswer, Unreachable, VrError
from robotree.vr.base.principal import this_process
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.on_loop import handled
from tests.vr.recorder import Recorder

ASKS_OR_PROLONGS = {
    req.Describe, req.Detach, req.Petition, req.Renew, req.ReadLog, req.ReadHistory, req.DescribeHost,
    req.Register, req.Query, req.Look, req.DescribeView, req.RenewEntry, req.RenewFence, req.WatchEntries,
    req.DescribeSpace, req.DescribeGateway, req.ReadEvents, req.VerifyEvents, req.ReadOrders, req.MarkSeen,
    req.FetchOrders, req.TellOrders, req.ReadKnown, req.ShareRecords, req.PrepareMove, req.TakeRobot,
    req.AskMove, req.ReadBundle,
}  # fmt: skip
"""Requests that are void when their caller no longer waits."""

ME = this_process()

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


class Sleeper(Robot):
    """Waits until it is ended."""

    @command
    def wait(self) -> None:
        self.sleep(60)


class Waiting(VirtualRobot):
    below = Child("Sleeper")

    @command
    def wait(self) -> None:
        self.below.wait()


def test_of_each_request_it_is_decided_how_late_it_may_come() -> None:
    kinds = (set(BEGINS), set(ENDS), ASKS_OR_PROLONGS)
    assert set[Any]().union(*kinds) == set(get_args(req.AnyRequest))
    assert sum(map(len, kinds)) == len(get_args(req.AnyRequest)), "each is of one kind"
    sealed = seal(req.Detach(key="k"), now=100.0, within=5.0)
    assert opened(sealed.body, ME, "a robot", 104.9).request == req.Detach(key="k")
    with pytest.raises(NoAnswer):
        opened(sealed.body, ME, "a robot", 105.1)


async def read(agent: RobotAgent, body: bytes) -> list[req.Reply]:
    """Let an agent find a request in its socket."""
    transport: Any = agent.transport
    answers: list[bytes] = []
    answered = handled(transport.served[agent.address.key], ME)(body, answers.append)
    assert answered is not None
    await answered
    return [req.decode_reply(answer, key="it") for answer in answers]


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
    assert [type(answer) for answer in answers] == [req.Raised]
    assert isinstance(answers[0], req.Raised)
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


def sealed_at(asked: float, within: float = 5.0) -> bytes:
    return seal(req.Call(key="k", command="move", deadline=5.0), now=asked, within=within).body


def test_on_another_machine_a_request_is_as_new_as_its_arrival() -> None:
    with on_clock("one machine"):
        body = sealed_at(100.0)
        assert opened(body, ME, "rover", 100.0 + FRESH - 0.1).asked == 100.0
        with pytest.raises(NoAnswer):
            opened(body, ME, "rover", 100.0 + FRESH)
    with on_clock("another machine"):
        assert opened(body, ME, "rover", 7000.0).asked == 7000.0


def test_a_system_that_does_not_name_its_clock_counts_from_the_arrival(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(envelope, "this_clock", lambda: "")
    assert opened(sealed_at(100.0), ME, "rover", 7000.0).asked == 7000.0


@pytest.mark.parametrize("asked", [math.nan, math.inf, 1e300])
def test_a_moment_that_has_not_come_yet_counts_as_now(asked: float) -> None:
    assert opened(sealed_at(asked), ME, "rover", 100.0).asked == 100.0


def test_only_what_ends_something_holds_for_ever() -> None:
    for request in (req.SafeStop(), req.Cancel()):
        assert opened(seal(request, now=0.0, within=1.0).body, ME, "rover", 1e6).request == request
    with pytest.raises(NoAnswer):
        opened(seal(req.Describe(), now=0.0, within=1.0).body, ME, "rover", 1.0)


def test_the_envelope_says_who_asks() -> None:
    body = seal(req.Describe(), now=0.0, within=1.0, sender="robot/parent/1").body
    assert opened(body, ME, "rover", 0.5).principal.agent == "robot/parent/1"


@given(st.binary(max_size=200))
def test_what_is_no_envelope_is_garbled(body: bytes) -> None:
    with pytest.raises((Garbled, NoAnswer)):
        opened(body, ME, "rover", 0.0)


async def test_a_deadline_does_not_grow_by_the_way(realm: Any) -> None:
    """Operator, carrier and rover are 0.2 s apart; the rover's command still ends by the operator's clock."""
    rover, carrier = await realm.start(Sleeper("sleeper")), await realm.start(Waiting("waiting"))
    client = RobotClient(realm.operator, carrier.address)
    await client.enslave("below", rover.address)
    realm.network.delay = 0.2
    began = asyncio.get_running_loop().time()
    call = asyncio.create_task(client.call("wait", {}, deadline=1.5))
    await realm.until(lambda: rover.description().busy == "wait")
    deadline_at = rover.runtime.look(lambda state: [call.deadline_at for call in state.calls.live.values()])
    assert deadline_at == [pytest.approx(began + 1.5, abs=0.01)]
    with pytest.raises(VrError, match="deadline"):
        await call
