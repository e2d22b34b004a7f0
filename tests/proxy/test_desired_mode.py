"""Stops and releases: what is asked for until it is confirmed, refused or unanswered, and over bad links."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.links.loopback import Faults
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
from robotree.proxy.desired_mode import (
    RELEASE_TIMEOUT,
    REPEAT_PERIOD,
    DesiredMode,
    ModeAnswer,
    ReleaseConfirmed,
    ReleaseRefused,
    ReleaseUnanswered,
    StopConfirmed,
)
from robotree.proxy.motion import Request
from robotree.proxy.session import OnlineChanged
from robotree.proxy.translate import Target
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import CommandFailed, NotConfirmed
from robotree.vr.core.confirmation import Budget, unmeasured
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.stop import CONFIRM
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import in_virtual_time

EPOCH = 5


def sent(desired: DesiredMode, now: float) -> list[tuple[int, int]]:
    """Which modes are asked for, and of which stop."""
    return [(message.mode, message.stops) for message in desired.messages_due(now)]


def receive(
    desired: DesiredMode, mode: ModeKind, stops: int, reason: Reason = Reason.NONE, *, restarted: bool = False
) -> list[ModeAnswer]:
    return desired.receive(
        Mode(1000, EPOCH, 1000, mode, reason, stops), restarted=restarted, was_stopped=restarted
    )


@pytest.fixture
def desired() -> DesiredMode:
    return DesiredMode(Target(1, 1))


@pytest.fixture
def stopped(desired: DesiredMode) -> DesiredMode:
    """One whose stop, the second of its controller, is confirmed."""
    desired.stop()
    assert sent(desired, 0.0) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(desired, ModeKind.SAFE_STOP, 2) == [StopConfirmed()]
    return desired


def test_a_release_waits_until_its_stop_is_confirmed_and_names_it(desired: DesiredMode) -> None:
    desired.stop()
    sent(desired, 0.0)
    desired.release(EPOCH, reported=1, now=0.1)
    assert sent(desired, 0.1) == []
    assert not desired.releasing
    assert receive(desired, ModeKind.READY, 1) == [], "that was told before the stop was heard"
    assert sent(desired, REPEAT_PERIOD) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(desired, ModeKind.SAFE_STOP, 2) == [StopConfirmed()]
    assert sent(desired, 0.5) == [(ModeKind.READY, 2)]
    assert desired.releasing


@pytest.mark.parametrize("late", [ModeKind.READY, ModeKind.ACTIVE])
def test_a_word_from_before_the_stop_ends_no_release_of_it(stopped: DesiredMode, late: ModeKind) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    assert receive(stopped, late, 1) == []
    assert sent(stopped, 1.0 + REPEAT_PERIOD) == [(ModeKind.READY, 2)]
    assert receive(stopped, late, 2) == [ReleaseConfirmed()]
    assert not stopped.stopped


def test_a_controller_that_counts_no_stops_is_believed(desired: DesiredMode) -> None:
    desired.stop()
    sent(desired, 0.0)
    desired.release(EPOCH, reported=0, now=0.1)
    assert receive(desired, ModeKind.READY, 0) == []
    receive(desired, ModeKind.SAFE_STOP, 0)
    assert sent(desired, 0.2) == [(ModeKind.READY, 0)]
    assert receive(desired, ModeKind.READY, 0) == [ReleaseConfirmed()]


def test_a_restart_ends_the_stop_that_was_to_be_released(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    stopped.opened()
    assert receive(stopped, ModeKind.READY, 1, restarted=True) == [ReleaseConfirmed()]
    assert sent(stopped, 2.0) == []


def test_a_release_that_is_somebody_elses_leaves_the_stop_to_them(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    assert receive(stopped, ModeKind.SAFE_STOP, 2, Reason.NOT_IN_CONTROL) == [
        ReleaseRefused(Reason.NOT_IN_CONTROL)
    ]
    receive(stopped, ModeKind.READY, 2)
    assert sent(stopped, 2.0) == [], "the holder has released it, and is not stopped again from here"


@pytest.mark.parametrize("reason", [Reason.STOPPED, Reason.STALE_EPOCH, Reason.BAD_EPOCH])
def test_a_release_that_was_refused_leaves_the_stop_wanted(stopped: DesiredMode, reason: Reason) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    assert receive(stopped, ModeKind.SAFE_STOP, 3, reason) == [ReleaseRefused(reason)]
    assert stopped.stopped
    assert sent(stopped, 2.0) == []
    receive(stopped, ModeKind.READY, 3)
    assert sent(stopped, 2.0) == [(ModeKind.SAFE_STOP, 0)], "somebody else has released it"


def test_a_release_that_nobody_answers_is_given_up_and_leaves_the_stop_wanted(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    assert stopped.expire(1.0 + RELEASE_TIMEOUT - 0.01) == []
    assert stopped.expire(1.0 + RELEASE_TIMEOUT) == [ReleaseUnanswered()]
    assert stopped.expire(9.0) == []
    stopped.opened()
    assert sent(stopped, 9.0) == [(ModeKind.SAFE_STOP, 0)]


def test_a_stop_takes_a_release_back_and_is_confirmed_anew(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    stopped.stop()
    assert sent(stopped, 1.01) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(stopped, ModeKind.READY, 2) == [], "the answer to the release that was taken back"
    assert sent(stopped, 1.01 + REPEAT_PERIOD) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(stopped, ModeKind.SAFE_STOP, 3) == [StopConfirmed()]


@pytest.mark.parametrize("end", ["taken back", "given up"])
def test_a_withdrawn_release_that_was_sent_is_followed_by_a_stop(desired: DesiredMode, end: str) -> None:
    receive(desired, ModeKind.SAFE_STOP, 2)
    desired.release(EPOCH, reported=2, now=1.0)
    assert sent(desired, 1.0) == [(ModeKind.READY, 2)]
    if end == "taken back":
        desired.withdraw()
    else:
        desired.expire(1.0 + RELEASE_TIMEOUT)
    assert sent(desired, 4.0) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(desired, ModeKind.READY, 2) == [], "the release arrived late"
    assert sent(desired, 5.0) == [(ModeKind.SAFE_STOP, 0)]


def test_a_release_that_never_left_makes_a_stop_of_somebody_else_not_ours(desired: DesiredMode) -> None:
    receive(desired, ModeKind.SAFE_STOP, 2)
    desired.release(EPOCH, reported=2, now=1.0)
    desired.withdraw()
    assert not desired.stopped
    assert sent(desired, 4.0) == []


def test_a_release_that_never_left_does_not_hide_one_that_did(desired: DesiredMode) -> None:
    receive(desired, ModeKind.SAFE_STOP, 2)
    desired.release(EPOCH, reported=2, now=1.0)
    sent(desired, 1.0)
    desired.release(EPOCH, reported=2, now=1.1)
    desired.withdraw()
    assert desired.stopped


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


Talk = Any


@pytest.mark.parametrize("seed", range(5))
def test_over_a_bad_link_a_release_ends_as_it_is_told(make_talk: type[Talk], seed: int) -> None:
    talk = make_talk(Faults(loss=0.4, delay=0.2, seed=seed))
    talk.wait(3.0)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(0.1)
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_TIMEOUT + 4.0)
    released = ReleaseConfirmed() in talk.events
    assert released != (ReleaseUnanswered() in talk.events)
    assert (talk.controller.mode == ModeKind.READY) == released
    assert talk.session.stopped != released


def test_a_release_whose_answer_was_lost_ends_no_stop_that_began_meanwhile(talk: Talk) -> None:
    talk.wait(0.5)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(1.0)
    talk.controller.mute = True
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.1)
    assert talk.controller.mode == ModeKind.READY
    talk.controller.stop()
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    talk.controller.mute = False
    talk.wait(1.0)
    assert "its controller is in safe stop" in talk.session.held
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.1)
    assert (talk.controller.mode, talk.session.held) == (ModeKind.READY, "")


def test_where_no_stop_is_known_of_a_release_is_done_also_while_the_controller_is_away(talk: Talk) -> None:
    talk.wait(1.0)
    talk.cut()
    talk.controller.stop()
    talk.perform(talk.session.release(1, talk.now))
    assert talk.events[-1] == ReleaseConfirmed()
    talk.wait(1.0)
    talk.connect()
    talk.wait(1.0)
    assert not [message for message in talk.controller.heard if isinstance(message, SetMode)]
    assert talk.session.held, "a stop that nobody could know of stays in force"


def test_of_a_controller_that_was_never_heard_it_is_not_known_whether_it_is_stopped(talk: Talk) -> None:
    talk.cut()
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_TIMEOUT + 0.1)
    assert [event for event in talk.events if not isinstance(event, OnlineChanged)] == [ReleaseUnanswered()]
    assert not talk.session.stopped
