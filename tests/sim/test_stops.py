"""No release undoes a stop that came after it, and nothing moves that a stop has overtaken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    CommandInt,
    CommandLong,
    GoalState,
    GoalStatus,
    Heartbeat,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Setpoint,
    SetpointKind,
    Verb,
)
from robotree.sim.controller.controller import Inbox, Received
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.testing import NAN, ArmBench, Operator, RoverBench

STOP, READY = ModeKind.SAFE_STOP, ModeKind.READY


def command(number: int, param1: float = 0.0, param2: float = 0.0, param3: float = 0.0) -> CommandLong:
    return CommandLong(1, 1, number, 0, param1, param2, param3, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("message", "stops"),
    [
        (SetMode(0, 0, 0, STOP), True),
        (SetMode(0, 0, 0, READY), False),
        (command(MavCmd.COMPONENT_ARM_DISARM, 0.0), True),
        (command(MavCmd.COMPONENT_ARM_DISARM, 1.0), False),
        (command(MavCmd.COMPONENT_ARM_DISARM, NAN), False),
        (command(MavCmd.DO_FLIGHTTERMINATION, 1.0), True),
        (command(MavCmd.DO_FLIGHTTERMINATION, 0.3), False),
        (command(MavCmd.DO_SET_MODE, 1.0, STOP), True),
        (command(MavCmd.DO_SET_MODE, 1.0, STOP, NAN), True),
        (command(MavCmd.DO_SET_MODE, 1.0, 4.0, 3.0), False),
        (command(MavCmd.DO_GRIPPER), False),
        (CommandInt(1, 1, 0, MavCmd.COMPONENT_ARM_DISARM, 0, 0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0), True),
        (Heartbeat(0, 0, 0, 0, 0), False),
    ],
)
def test_every_way_to_ask_for_a_stop_is_one(message: AnyMessage, stops: bool) -> None:  # noqa: FBT001
    assert stop_asked_by(message) == stops
    arm = ArmBench()
    arm.operator.say(message)
    arm.operator.wait(0.05)
    assert (arm.operator.mode()[0] == STOP) == stops


def test_a_stop_for_another_robot_overtakes_nothing() -> None:
    inbox = Inbox(1)
    inbox.put(Frame.of(Heartbeat(0, 0, 0, 0, 0)), "link")
    inbox.put(Frame.of(SetMode(0, 7, 0, STOP)), "link")
    heard = [event for event in inbox.take() if isinstance(event, Received)]
    assert [type(event.frame.message) for event in heard] == [Heartbeat, SetMode]
    assert not any(event.overtaken for event in heard)


LINKS = ("a", "b", "c")
ARRIVALS = st.lists(st.tuples(st.sampled_from(LINKS), st.sampled_from((STOP, READY, None))), max_size=60)


@given(ARRIVALS)
def test_what_is_heard_after_a_later_stop_is_marked_and_nothing_else_is(
    arrivals: list[tuple[str, ModeKind | None]],
) -> None:
    inbox, order, stops, heard = Inbox(1), dict[Frame, int](), list[int](), list[Received]()
    for number, (via, word) in enumerate(arrivals):
        if word is None:
            heard += [event for event in inbox.take() if isinstance(event, Received)]
            continue
        frame = Frame.of(SetMode(number, 1, 1, word))
        order[frame] = number
        if word == STOP:
            stops.append(number)
        inbox.put(frame, via)
    for _ in range(100):
        heard += [event for event in inbox.take() if isinstance(event, Received)]
    newest = -1
    for event in heard:
        arrived = order[event.frame]
        if arrived in stops:
            newest = max(newest, arrived)
        elif event.overtaken:
            assert any(stop > arrived for stop in stops), "only a later stop overtakes"
        else:
            assert newest <= arrived, "what a stop overtook is marked"


@pytest.mark.parametrize(
    "release",
    [
        SetMode(1, 1, 1, READY),
        command(MavCmd.COMPONENT_ARM_DISARM, 1.0),
        command(MavCmd.DO_SET_MODE, 1.0, READY),
    ],
)
def test_a_release_in_the_same_batch_before_a_stop_does_not_undo_it(
    rover: RoverBench, release: AnyMessage
) -> None:
    operator = rover.operator
    operator.say(release)
    operator.set_mode(STOP)
    operator.wait(0.5)
    assert operator.mode() == (STOP, Reason.OPERATOR)
    if isinstance(release, SetMode):
        assert Reason.STOPPED in {mode.reason for mode in operator.all(Mode)}
    else:
        ack = operator.latest(CommandAck)
        assert (ack.result, ack.result_param2) == (MavResult.TEMPORARILY_REJECTED, Reason.STOPPED)


def flood(operator: Operator, goals: int) -> None:
    for _ in range(goals):
        operator.ask(Verb.MOVE, 0.05, 0.0, epoch=0)


def test_a_release_after_the_stop_wakes_nothing_that_the_stop_has_overtaken(rover: RoverBench) -> None:
    ann = rover.operator
    bob = ann.another()
    flood(ann, 100)
    ann.say(Setpoint(0, 0, 1, (0.3, *(NAN,) * 6), 2000, 1, 1, SetpointKind.BASE_VELOCITY))
    ann.order(MavCmd.ROBOTREE_MOVE, 0.05, 0.0)
    ann.wait(0.02)
    bob.set_mode(STOP)
    bob.wait(0.02)
    bob.set_mode(READY, epoch=0)
    bob.wait(0.1)
    assert bob.mode() == (READY, Reason.NONE)
    place = rover.world.rover.state().position
    ann.wait(4.0)
    assert np.linalg.norm(rover.world.rover.state().position - place) < 0.01
    ends = {(status.state, status.reason) for status in ann.all(GoalStatus)[-90:]}
    assert ends == {(GoalState.REFUSED, Reason.STOPPED)}
    assert ann.latest(CommandAck).result == MavResult.TEMPORARILY_REJECTED


def test_a_hold_overtakes_nothing_and_ends_what_was_asked_for_before_it(arm: ArmBench) -> None:
    operator = arm.operator
    before = arm.world.arm.state().position
    operator.order(MavCmd.ROBOTREE_GO_TO, 0.35, -0.25, 0.35, 0.5)
    operator.say(command(MavCmd.DO_SET_MODE, 1.0, 4.0, 3.0))
    operator.wait(2.0)
    assert operator.mode() == (READY, Reason.NONE)
    assert np.linalg.norm(arm.world.arm.state().position - before) < 0.02
