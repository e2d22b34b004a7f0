"""Commands of the field's tools: the same movements as goals, the same stops, and honest answers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    GoalState,
    MavCmd,
    MavResult,
    ModeKind,
    Reason,
    Statustext,
    Verb,
)
from robotree.protocol.services.command import COUNTED_REPETITION
from robotree.sim.testing import NAN, ArmBench, Operator, RoverBench

AWAY = (0.35, -0.25, 0.35, 0.5)
KILL = 21196.0


def result(operator: Operator, command: int, *params: float) -> MavResult:
    return MavResult(operator.command(command, *params).result)


def go(operator: Operator, *, speed: float = 0.0) -> None:
    operator.order(MavCmd.ROBOTREE_GO_TO, *AWAY, NAN, NAN, speed)


def last(operator: Operator) -> CommandAck:
    return operator.latest(CommandAck)


def text(operator: Operator) -> str:
    return " ".join(message.text for message in operator.all(Statustext))


def test_a_named_command_tells_its_progress_and_its_end(arm: ArmBench) -> None:
    operator = arm.operator
    go(operator)
    operator.until(lambda: bool(operator.all(CommandAck)) and last(operator).result == 0, 30.0)
    told = [ack.progress for ack in operator.all(CommandAck) if ack.result == MavResult.IN_PROGRESS]
    assert told[0] == 255, "at first it is unknown"
    assert len(told) > 3
    assert told[1:] == sorted(told[1:])
    np.testing.assert_allclose(arm.world.arm.state().position, AWAY[:3], atol=0.004)


@pytest.mark.parametrize("between", ["stop and release", "stop", "another movement", "a cancel"])
def test_a_success_is_repeated_only_while_nothing_else_was_done(arm: ArmBench, between: str) -> None:
    """DO_GRIPPER succeeds at once; who orders it again after a stop means it."""
    operator = arm.operator
    assert result(operator, MavCmd.DO_GRIPPER, 1, 1) == MavResult.ACCEPTED
    if between == "another movement":
        result(operator, MavCmd.ROBOTREE_HOLD)
    elif between == "a cancel":
        operator.cancel(0, epoch=0)
    else:
        operator.set_mode(ModeKind.SAFE_STOP, epoch=0)
    operator.wait(0.1)
    if between == "stop and release":
        operator.set_mode(ModeKind.READY, epoch=0)
        operator.wait(0.1)
    width = arm.world.arm.state().width
    assert width > 0.04, "it was ended on its way"
    again = result(operator, MavCmd.DO_GRIPPER, 1, 1)
    if between == "stop":
        assert again == MavResult.TEMPORARILY_REJECTED
    else:
        assert again == MavResult.ACCEPTED
        operator.until(lambda: arm.world.arm.state().width < 0.002, 3.0)


def test_the_gripper_grabs_and_releases(arm: ArmBench) -> None:
    assert result(arm.operator, MavCmd.DO_GRIPPER, 1, 1) == MavResult.ACCEPTED
    arm.operator.until(lambda: arm.world.arm.state().width < 0.002, 3.0)
    assert result(arm.operator, MavCmd.DO_GRIPPER, 0, 0) == MavResult.ACCEPTED
    arm.operator.until(lambda: arm.world.arm.state().width > 0.078, 3.0)
    arm.operator.order(MavCmd.DO_GRIPPER, 1, 1)
    arm.operator.wait(0.2)
    assert result(arm.operator, MavCmd.ROBOTREE_HOLD) == MavResult.ACCEPTED
    width = arm.world.arm.state().width
    assert result(arm.operator, MavCmd.DO_GRIPPER, 1, 2) == MavResult.ACCEPTED
    arm.operator.wait(1.0)
    assert arm.world.arm.state().width == pytest.approx(width, abs=0.003)


def test_the_gripper_answers_once_and_at_once(arm: ArmBench) -> None:
    """MAVSDK's gripper plugin breaks at a second answer."""
    arm.operator.order(MavCmd.DO_GRIPPER, 1, 1)
    arm.operator.wait(3.0)
    assert [ack.result for ack in arm.operator.all(CommandAck)] == [MavResult.ACCEPTED]


@pytest.mark.parametrize("params", [(2, 1), (1, 7), (1, math.nan), (math.inf, 1)])
def test_a_gripper_that_is_not_there_or_an_unknown_action_is_denied(
    arm: ArmBench, params: tuple[float, ...]
) -> None:
    assert result(arm.operator, MavCmd.DO_GRIPPER, *params) == MavResult.DENIED


def test_a_rover_has_no_gripper(rover: RoverBench) -> None:
    assert result(rover.operator, MavCmd.DO_GRIPPER, 1, 1) == MavResult.UNSUPPORTED


def test_a_command_takes_the_place_of_a_goal_and_a_goal_that_of_a_command(arm: ArmBench) -> None:
    operator = arm.operator
    goal = operator.ask(Verb.GO_TO, 0.35, 0.25, 0.35, 0.5, epoch=0)
    operator.wait(0.3)
    go(operator)
    ended = operator.end_of(goal, within=0.1)
    assert (ended.state, ended.reason) == (GoalState.CANCELLED, Reason.SUPERSEDED)
    operator.wait(0.3)
    operator.ask(Verb.GO_TO, 0.35, 0.25, 0.35, 0.5, epoch=0)
    operator.until(lambda: last(operator).result == MavResult.CANCELLED, 0.1)
    assert last(operator).result_param2 == Reason.SUPERSEDED


def test_the_end_of_whichever_goal_runs_ends_a_command_too(arm: ArmBench) -> None:
    go(arm.operator, speed=0.05)
    arm.operator.wait(0.5)
    arm.operator.cancel(0)
    arm.operator.wait(0.1)
    assert last(arm.operator).result == MavResult.CANCELLED


def test_arming_releases_the_stop(arm: ArmBench) -> None:
    assert result(arm.operator, MavCmd.COMPONENT_ARM_DISARM, 0, KILL) == MavResult.ACCEPTED
    assert result(arm.operator, MavCmd.COMPONENT_ARM_DISARM, 1) == MavResult.ACCEPTED
    arm.operator.wait(0.05)
    assert arm.operator.mode()[0] == ModeKind.READY


ARM = (MavCmd.COMPONENT_ARM_DISARM, 1.0, 0.0)
SET_READY = (MavCmd.DO_SET_MODE, 1.0, float(ModeKind.READY))
RELEASES = pytest.mark.parametrize("release", [ARM, SET_READY], ids=["arm", "set mode"])


def say(operator: Operator, release: tuple[float, ...], confirmation: int) -> tuple[MavResult, ModeKind]:
    """What is answered to a release, and in which mode the robot is then."""
    told = len(operator.all(CommandAck))
    operator.say(CommandLong(1, 1, int(release[0]), confirmation, *release[1:], *(0.0,) * 5))
    operator.wait(0.05)
    (ack,) = operator.all(CommandAck)[told:]
    return MavResult(ack.result), operator.mode()[0]


@RELEASES
def test_the_repetition_of_a_release_does_not_undo_a_stop_that_came_in_between(
    rover: RoverBench, release: tuple[float, ...]
) -> None:
    stranger = rover.operator.another(system=99)
    stranger.set_mode(ModeKind.SAFE_STOP)
    stranger.wait(0.05)
    assert say(rover.operator, release, 0) == (MavResult.ACCEPTED, ModeKind.READY)
    assert say(rover.operator, release, 1) == (MavResult.ACCEPTED, ModeKind.READY), "nothing came in between"
    stranger.set_mode(ModeKind.SAFE_STOP)
    stranger.wait(0.05)
    for confirmation in (2, 3):
        refused = say(rover.operator, release, confirmation)
        assert refused == (MavResult.TEMPORARILY_REJECTED, ModeKind.SAFE_STOP)
    assert last(rover.operator).result_param2 == Reason.STOPPED
    assert "look at the robot" in text(rover.operator)
    assert say(rover.operator, release, 0) == (MavResult.ACCEPTED, ModeKind.READY), "that is a new order"


def test_the_repetition_of_a_release_does_not_undo_a_later_stop_of_the_same_sender(rover: RoverBench) -> None:
    disarm = (MavCmd.COMPONENT_ARM_DISARM, 0.0, 0.0)
    assert say(rover.operator, disarm, 0) == (MavResult.ACCEPTED, ModeKind.SAFE_STOP)
    assert say(rover.operator, ARM, 1) == (MavResult.ACCEPTED, ModeKind.READY), "its first frame was lost"
    assert say(rover.operator, disarm, 0) == (MavResult.ACCEPTED, ModeKind.SAFE_STOP)
    assert say(rover.operator, ARM, 2) == (MavResult.TEMPORARILY_REJECTED, ModeKind.SAFE_STOP)


@RELEASES
def test_the_repetition_of_a_release_that_a_stop_has_overtaken_does_not_undo_it(
    rover: RoverBench, release: tuple[float, ...]
) -> None:
    rover.operator.say(CommandLong(1, 1, int(release[0]), 0, *release[1:], *(0.0,) * 5))
    rover.operator.set_mode(ModeKind.SAFE_STOP)
    rover.operator.wait(0.05)
    assert last(rover.operator).result == MavResult.TEMPORARILY_REJECTED
    assert say(rover.operator, release, 1) == (MavResult.TEMPORARILY_REJECTED, ModeKind.SAFE_STOP)


@RELEASES
def test_a_release_whose_first_transmission_was_lost_is_obeyed(
    rover: RoverBench, release: tuple[float, ...]
) -> None:
    rover.operator.set_mode(ModeKind.SAFE_STOP)
    rover.operator.wait(0.05)
    assert say(rover.operator, release, 1) == (MavResult.ACCEPTED, ModeKind.READY)
    rover.operator.wait(COUNTED_REPETITION + 1.0)
    rover.operator.set_mode(ModeKind.SAFE_STOP)
    rover.operator.wait(0.05)
    assert say(rover.operator, release, 2) == (MavResult.ACCEPTED, ModeKind.READY), "nobody repeats that late"


def test_where_a_lease_was_obeyed_a_command_needs_control_to_move_or_to_release(arm: ArmBench) -> None:
    arm.operator.do(Verb.GRIP, 0.05, epoch=7)
    stranger = arm.operator.another(system=99)
    result(stranger, MavCmd.COMPONENT_ARM_DISARM, 0)
    assert result(stranger, MavCmd.COMPONENT_ARM_DISARM, 1) == MavResult.TEMPORARILY_REJECTED
    assert result(stranger, MavCmd.ROBOTREE_GO_TO, *AWAY) == MavResult.TEMPORARILY_REJECTED
    stranger.wait(0.02)
    assert "32100" in text(stranger)
    assert arm.operator.mode()[0] == ModeKind.SAFE_STOP
    assert result(stranger, MavCmd.REQUEST_OPERATOR_CONTROL, 1, 1) == MavResult.ACCEPTED
    assert result(stranger, MavCmd.COMPONENT_ARM_DISARM, 1) == MavResult.ACCEPTED
    assert result(stranger, MavCmd.ROBOTREE_GO_TO, *AWAY) == MavResult.ACCEPTED


def test_mavsdks_hold_ends_what_runs_and_is_no_stop(arm: ArmBench) -> None:
    goal = arm.operator.ask(Verb.GO_TO, *AWAY, epoch=0)
    arm.operator.wait(0.3)
    assert result(arm.operator, MavCmd.DO_SET_MODE, 1, 4, 3) == MavResult.ACCEPTED
    assert arm.operator.end_of(goal, within=0.1).state == GoalState.CANCELLED
    assert arm.operator.mode()[0] == ModeKind.READY


@pytest.mark.parametrize(
    ("command", "params"),
    [
        (MavCmd.PREFLIGHT_REBOOT_SHUTDOWN, (1.0,)),
        (MavCmd.DO_SET_MODE, (1.0, 77.0)),
        (MavCmd.COMPONENT_ARM_DISARM, (5.0,)),
        (MavCmd.DO_FLIGHTTERMINATION, (0.0,)),
    ],
)
def test_what_it_does_for_nobody_is_denied_with_a_sentence(
    arm: ArmBench, command: int, params: tuple[float, ...]
) -> None:
    assert result(arm.operator, command, *params) == MavResult.DENIED
    arm.operator.wait(0.02)
    assert text(arm.operator).endswith(".")
    assert arm.operator.mode()[0] == ModeKind.READY


def test_a_command_ends_with_the_link_that_it_came_over(arm: ArmBench) -> None:
    leaver = arm.operator.another(system=99)
    go(leaver, speed=0.02)
    leaver.wait(0.5)
    leaver.leave()
    arm.operator.wait(0.02)
    assert arm.operator.mode() == (ModeKind.HOLD, Reason.LINK_SILENT)


def test_a_command_for_another_system_or_component_is_not_ours(arm: ArmBench) -> None:
    for system, component in ((2, 1), (1, 77), (2, 0)):
        arm.operator.say(CommandLong(system, component, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7))
    arm.operator.wait(0.1)
    assert arm.operator.all(CommandAck) == []
    assert arm.operator.mode()[0] == ModeKind.READY


@pytest.mark.parametrize("sub", [1.0, 2.0, 4.0, 5.0, 6.0])
def test_a_mode_that_only_px4_has_is_refused_and_is_no_stop(arm: ArmBench, sub: float) -> None:
    """Take off, mission, return to launch, land: who asks for one must not read that it was done."""
    go(arm.operator, speed=0.02)
    arm.operator.wait(0.2)
    assert result(arm.operator, MavCmd.DO_SET_MODE, 1.0, 4.0, sub) == MavResult.DENIED
    arm.operator.wait(0.02)
    assert "cannot take off, return or land" in text(arm.operator)
    assert arm.operator.mode()[0] == ModeKind.ACTIVE


def test_a_pause_holds_and_a_continue_makes_ready_but_moves_nothing(arm: ArmBench) -> None:
    operator = arm.operator
    go(operator, speed=0.02)
    operator.wait(0.2)
    assert result(operator, MavCmd.DO_PAUSE_CONTINUE, 0.0) == MavResult.ACCEPTED
    operator.wait(0.2)
    assert operator.mode()[0] == ModeKind.READY
    assert result(operator, MavCmd.DO_PAUSE_CONTINUE, 1.0) == MavResult.ACCEPTED
    operator.wait(0.5)
    assert text(operator).endswith("Ready. What was held has ended; ask for it again.")
    assert operator.mode()[0] == ModeKind.READY


def test_a_continue_releases_no_safe_stop(arm: ArmBench) -> None:
    operator = arm.operator
    assert result(operator, MavCmd.COMPONENT_ARM_DISARM, 0.0) == MavResult.ACCEPTED
    assert result(operator, MavCmd.DO_PAUSE_CONTINUE, 1.0) == MavResult.TEMPORARILY_REJECTED
    assert result(operator, MavCmd.DO_PAUSE_CONTINUE, 7.0) == MavResult.DENIED
    assert operator.mode()[0] == ModeKind.SAFE_STOP
