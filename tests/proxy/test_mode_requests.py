"""When a stop or a resume of a proxy is told as done: once its controller has said so, not before."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    AnyMessage,
    Goal,
    GoalCancel,
    Heartbeat,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.services.goal_client import RESEND
from robotree.proxy.arm import Arm
from robotree.proxy.connection import GRID
from robotree.proxy.desired_mode import RELEASE_TIMEOUT, REPEAT_PERIOD
from robotree.proxy.motion import Request
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import CommandFailed, NotConfirmed
from robotree.vr.core.confirmation import Budget, unmeasured
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.stop import CONFIRM
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import in_virtual_time

BEAT = Heartbeat(0, 0, 0, 0, 4)


class Place:
    """A proxy whose controller is the test."""

    def __init__(self) -> None:
        self.robot = Arm("arm-1", "tcp:127.0.0.1:5760")
        self.session, self.connection = self.robot._session, self.robot._connection
        self.said: list[int] = []
        """The modes that were asked for."""
        self.connection._send = self._note

    def connect(self) -> None:
        self.connection.perform(self.session.opened(self.connection.now()))
        self.hear(BEAT)

    def cut(self) -> None:
        self.connection.perform(self.session.closed("the cable was pulled"))

    def hear(self, message: AnyMessage) -> None:
        frame = Frame.of(message, system=1, component=1)
        self.connection.perform(self.session.receive(frame, self.connection.now()))

    def tell(self, mode: ModeKind, stops: int, reason: Reason = Reason.NONE) -> None:
        self.hear(Mode(1000, 1, 1000, mode, reason, stops))

    def _note(self, message: AnyMessage) -> None:
        if isinstance(message, SetMode):
            self.said.append(message.mode)

    def pass_time(self, seconds: float) -> None:
        self.connection.perform(self.session.tick(self.connection.now() + seconds))


@pytest.fixture
def place() -> Place:
    place = Place()
    place.connect()
    place.tell(ModeKind.READY, 1)
    return place


async def waiting(order: Awaitable[None]) -> asyncio.Task[None]:
    async def wait() -> None:
        await order

    task = asyncio.create_task(wait())
    await settle()
    return task


async def settle() -> None:
    """Let everybody who waits take note."""
    for _ in range(5):
        await asyncio.sleep(0)


async def test_a_stop_is_told_as_done_when_the_controller_has_confirmed_it(place: Place) -> None:
    stop = await waiting(place.robot.safe_stop("a hand in the cell"))
    place.tell(ModeKind.READY, 1)
    await settle()
    assert not stop.done(), "the controller lives and was told, and has confirmed nothing"
    place.tell(ModeKind.SAFE_STOP, 2)
    await settle()
    assert stop.done()
    await stop


async def test_a_stop_of_a_robot_that_is_away_is_done_when_it_has_come_back_and_confirmed_it(
    place: Place,
) -> None:
    place.cut()
    stop = await waiting(place.robot.safe_stop("a hand in the cell"))
    place.pass_time(60.0)
    place.connect()
    await settle()
    assert not stop.done()
    place.tell(ModeKind.SAFE_STOP, 2)
    await settle()
    assert stop.done()


async def test_who_waits_for_a_stop_no_longer_does_not_take_it_back_nor_ends_the_wait_of_others(
    place: Place,
) -> None:
    order = place.robot.safe_stop("a hand in the cell")
    gone, stays = await waiting(order), await waiting(order)
    gone.cancel()
    await settle()
    assert gone.cancelled()
    assert place.session.stopped
    place.tell(ModeKind.SAFE_STOP, 2)
    await stays


async def test_a_resume_is_told_as_done_when_the_controller_is_not_held(place: Place) -> None:
    place.robot.safe_stop("a hand in the cell")
    place.tell(ModeKind.SAFE_STOP, 2)
    resume = await waiting(place.robot.resume())
    place.tell(ModeKind.SAFE_STOP, 2)
    await settle()
    assert not resume.done()
    place.tell(ModeKind.READY, 2)
    await resume


@pytest.mark.parametrize(
    ("reason", "advice"),
    [
        (Reason.STOPPED, r"another stop came after .*; when it is safe, resume again"),
        (Reason.STALE_EPOCH, "a newer lease is already obeyed; resume again"),
        (Reason.NOT_IN_CONTROL, "somebody else commands the controller; ask them to give it up"),
    ],
)
async def test_a_resume_that_the_controller_refuses_says_why_and_what_to_do(
    place: Place, reason: Reason, advice: str
) -> None:
    place.tell(ModeKind.SAFE_STOP, 2)
    resume = await waiting(place.robot.resume())
    place.tell(ModeKind.SAFE_STOP, 3, reason)
    with pytest.raises(CommandFailed, match=f"arm-1.resume failed: its controller does not .*: {advice}"):
        await resume


async def test_a_resume_that_was_given_up_says_so(place: Place) -> None:
    place.tell(ModeKind.SAFE_STOP, 2)
    resume = await waiting(place.robot.resume())
    place.pass_time(RELEASE_TIMEOUT)
    with pytest.raises(CommandFailed, match=r"answered for 2\.2 s; it is not released; .*, then resume"):
        await resume
    place.cut()
    resume = await waiting(place.robot.resume())
    place.pass_time(RELEASE_TIMEOUT)
    with pytest.raises(CommandFailed, match="the cable was pulled; it is not released"):
        await resume


async def test_the_newest_order_ends_the_wait_of_those_before_it(place: Place) -> None:
    stop = await waiting(place.robot.safe_stop("a hand in the cell"))
    resume = await waiting(place.robot.resume())
    with pytest.raises(CommandFailed, match=r"arm-1\.safe_stop failed: a resume came after it"):
        await stop
    again = await waiting(place.robot.safe_stop("again"))
    with pytest.raises(CommandFailed, match=r"arm-1\.resume failed: a stop came after it"):
        await resume
    place.tell(ModeKind.SAFE_STOP, 2)
    await again


async def test_a_resume_of_a_robot_that_nobody_stopped_is_done_at_once_though_it_is_away(
    place: Place,
) -> None:
    place.cut()
    resume = await waiting(place.robot.resume())
    assert resume.done()
    await resume


@pytest.mark.parametrize("ours", [True, False])
async def test_a_resume_that_nobody_waits_for_any_more_is_taken_back(place: Place, *, ours: bool) -> None:
    if ours:
        place.robot.safe_stop("a hand in the cell")
    place.tell(ModeKind.SAFE_STOP, 2)
    place.said.clear()
    resume = await waiting(place.robot.resume())
    resume.cancel()
    await settle()
    assert place.said == [ModeKind.READY, ModeKind.SAFE_STOP], "obeying the first, it obeys the second"
    assert place.session.stopped
    place.tell(ModeKind.READY, 2)
    assert place.session.held == "its controller has yet to confirm the stop"


@in_virtual_time
async def test_who_is_told_that_a_resume_is_not_confirmed_finds_the_robot_stopped_for_good(
    place: Place,
) -> None:
    """The agent of a robot deep in a tree waits for less than its proxy pursues a release."""
    network = MemoryNetwork()
    agent = RobotAgent(place.robot, network.join("proxy"))
    await agent.start()
    place.tell(ModeKind.SAFE_STOP, 2)
    client = RobotClient(network.join("above"), agent.address, patience=RELEASE_TIMEOUT)
    with pytest.raises(NotConfirmed, match="its controller has not confirmed it"):
        await client.resume()
    place.tell(ModeKind.READY, 2)
    place.pass_time(REPEAT_PERIOD)
    assert place.said == [ModeKind.READY, ModeKind.SAFE_STOP, ModeKind.SAFE_STOP], "it is stopped again"
    assert place.session.held
    await agent.close()


async def test_a_resume_that_somebody_else_waits_for_is_not_taken_back(place: Place) -> None:
    place.tell(ModeKind.SAFE_STOP, 2)
    gone, stays = await waiting(place.robot.resume()), await waiting(place.robot.resume())
    gone.cancel()
    await settle()
    place.tell(ModeKind.READY, 2)
    await stays
    assert not place.session.stopped


async def test_a_resume_whose_confirmation_came_too_late_to_be_heard_is_taken_back(place: Place) -> None:
    place.tell(ModeKind.SAFE_STOP, 2)
    resume = await waiting(place.robot.resume())
    place.tell(ModeKind.READY, 2)
    resume.cancel()
    await settle()
    assert resume.cancelled()
    assert place.session.stopped


def test_a_resume_is_given_up_before_the_agent_that_waits_for_it_gives_up() -> None:
    assert Budget(unmeasured(CONFIRM)).wait > RELEASE_TIMEOUT + GRID


async def test_a_stop_calls_off_what_ended_commands_have_asked_for_before_a_release_can_be_said(
    place: Place,
) -> None:
    sent: list[AnyMessage] = []
    place.connection._send = sent.append
    activity: Any = SimpleNamespace(cancelled=False, context=SimpleNamespace(epoch=1))
    place.robot._pending.start(7, Request(Verb.HOLD, ()), activity=activity, ttl=0.0, repeatable=True)
    activity.cancelled = True  # the agent has ended it; its thread has yet to take note
    place.robot.safe_stop("a hand in the cell")
    place.tell(ModeKind.SAFE_STOP, 2)
    place.robot.resume()
    place.tell(ModeKind.READY, 2)
    place.pass_time(RESEND)
    asked = [type(message) for message in sent if not isinstance(message, Heartbeat)]
    assert asked == [Goal, GoalCancel, SetMode, SetMode, GoalCancel]
