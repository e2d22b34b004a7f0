"""Operator control: one commands, the others watch, and anyone may stop."""

from __future__ import annotations

import pytest

from robotree.protocol.messages import (
    ControlStatus,
    GoalState,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    Reason,
    Setpoint,
    SetpointKind,
    Verb,
)
from robotree.sim.testing import NAN, Operator, RoverBench


@pytest.fixture
def other(rover: RoverBench) -> Operator:
    return rover.operator.another(system=77)


def take(operator: Operator, *, takeover: bool = False) -> None:
    ack = operator.command(MavCmd.REQUEST_OPERATOR_CONTROL, 1, float(takeover))
    assert ack.result == MavResult.ACCEPTED
    operator.wait(0.02)


def test_goals_of_others_are_refused_and_may_be_asked_again_later(rover: RoverBench, other: Operator) -> None:
    take(rover.operator)
    refused = other.do(Verb.MOVE, 0.1, 0.0, epoch=9)
    assert (refused.state, refused.reason) == (GoalState.REFUSED, Reason.NOT_IN_CONTROL)
    assert "255" in refused.text
    assert rover.operator.latest(Mode).epoch == 0, "who may not command fences nobody"
    rover.operator.succeed(Verb.MOVE, 0.1, 0.0)
    rover.operator.command(MavCmd.REQUEST_OPERATOR_CONTROL, 0)
    other.ask(Verb.MOVE, 0.1, 0.0, epoch=9, key=refused.key)
    other.wait(0.05)
    assert other.status_of(refused.key).state == GoalState.ACTIVE


def test_commands_and_set_points_of_others_do_nothing(rover: RoverBench, other: Operator) -> None:
    take(rover.operator)
    assert other.command(MavCmd.ROBOTREE_MOVE, 0.1, 0.0).result == MavResult.TEMPORARILY_REJECTED
    for number in range(1, 20):
        other.say(Setpoint(0, 0, number, (0.3, 0.0, *(NAN,) * 5), 200, 1, 1, SetpointKind.BASE_VELOCITY))
        other.wait(0.05)
    assert rover.world.rover.state().position[0] == pytest.approx(0.0, abs=0.002)


def test_who_takes_control_ends_what_others_move(rover: RoverBench, other: Operator) -> None:
    running = other.ask(Verb.MOVE, 1.0, 0.0, epoch=3)
    other.wait(0.3)
    take(rover.operator)
    ended = other.end_of(running, within=0.1)
    assert (ended.state, ended.reason) == (GoalState.CANCELLED, Reason.NOT_IN_CONTROL)


def test_a_stop_is_everyones_and_its_release_is_not(rover: RoverBench, other: Operator) -> None:
    take(rover.operator)
    other.set_mode(ModeKind.SAFE_STOP, epoch=0)
    other.wait(0.05)
    assert other.mode()[0] == ModeKind.SAFE_STOP
    other.set_mode(ModeKind.READY, epoch=99)
    other.wait(0.05)
    assert Reason.NOT_IN_CONTROL in {mode.reason for mode in other.all(Mode)}
    assert other.mode()[0] == ModeKind.SAFE_STOP
    rover.operator.set_mode(ModeKind.READY)
    rover.operator.wait(0.05)
    assert other.mode()[0] == ModeKind.READY


@pytest.mark.parametrize("verb", [Verb.STATUS, Verb.MOVE])
def test_a_namesake_without_control_does_not_hide_that_the_owner_has_died(
    rover: RoverBench, verb: Verb
) -> None:
    namesake = rover.operator.another(component=190, system=255)
    take(rover.operator)
    running = rover.operator.ask(Verb.MOVE, 1.0, 0.0, 0.02)
    namesake.wait(0.1)
    namesake.ask(verb, 1.0, 0.0, 0.02, key=running)
    rover.operator.silent = True
    namesake.wait(3.2)
    assert namesake.mode() == (ModeKind.HOLD, Reason.LINK_SILENT)
    assert namesake.latest(ControlStatus).gcs_main == 0
    namesake.ask(Verb.STATUS, key=running)
    namesake.wait(0.1)
    assert namesake.status_of(running).reason == Reason.LINK_SILENT
