"""Operator control: one commands, the others watch, and anyone may stop."""

from __future__ import annotations

import pytest

from robotree.protocol.messages import (
    CommandLong,
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


def test_everyone_is_told_once_a_second_who_is_in_control(rover: RoverBench, other: Operator) -> None:
    rover.operator.wait(3.0)
    assert {status.gcs_main for status in other.all(ControlStatus)} == {0}
    before = len(other.all(ControlStatus))
    take(rover.operator)
    assert other.latest(ControlStatus).gcs_main == 255
    rover.operator.wait(5.0)
    assert len(other.all(ControlStatus)) - before == pytest.approx(6, abs=1)


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


def test_the_robots_own_system_id_opens_no_door(rover: RoverBench) -> None:
    impostor = rover.operator.another(component=191, system=1)
    take(rover.operator)
    assert impostor.command(MavCmd.ROBOTREE_MOVE, 0.1, 0.0).result == MavResult.TEMPORARILY_REJECTED
    assert impostor.do(Verb.MOVE, 0.1, 0.0).reason == Reason.NOT_IN_CONTROL


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


def test_a_cancel_is_everyones_and_locks_nobody_out(rover: RoverBench, other: Operator) -> None:
    take(rover.operator)
    running = rover.operator.ask(Verb.MOVE, 1.0, 0.0, epoch=5)
    rover.operator.wait(0.3)
    other.cancel(0, epoch=9)
    assert rover.operator.end_of(running, within=0.1).reason == Reason.OPERATOR
    assert rover.operator.latest(Mode).epoch == 5
    assert rover.operator.do(Verb.MOVE, 0.02, 0.0, epoch=5).state == GoalState.SUCCEEDED
    other.set_mode(ModeKind.SAFE_STOP)
    other.wait(0.05)
    rover.operator.set_mode(ModeKind.READY, epoch=5)
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


def test_the_owner_is_told_who_wants_control_and_may_have_allowed_it(
    rover: RoverBench, other: Operator
) -> None:
    take(rover.operator)
    assert other.command(MavCmd.REQUEST_OPERATOR_CONTROL, 1, 0, 5).result == MavResult.FAILED
    rover.operator.wait(0.05)
    wish = rover.operator.latest(CommandLong)
    assert (wish.command, wish.param4) == (MavCmd.REQUEST_OPERATOR_CONTROL, 77)
    take(rover.operator, takeover=True)
    take(other)
    assert rover.operator.latest(ControlStatus).gcs_main == 77


@pytest.mark.parametrize("how", ["silence", "end of the link"])
def test_an_owner_who_is_gone_is_in_control_no_more(rover: RoverBench, other: Operator, how: str) -> None:
    take(other)
    if how == "silence":
        other.silent = True
        rover.operator.wait(3.2)
    else:
        other.leave()
        rover.operator.wait(0.05)
    assert rover.operator.latest(ControlStatus).gcs_main == 0
    rover.operator.succeed(Verb.MOVE, 0.05, 0.0)


def test_while_nobody_is_in_control_everybody_may_by_epoch(rover: RoverBench, other: Operator) -> None:
    rover.operator.succeed(Verb.MOVE, 0.02, 0.0)
    assert other.do(Verb.MOVE, 0.02, 0.0, epoch=2).state == GoalState.SUCCEEDED
    assert rover.operator.do(Verb.MOVE, 0.02, 0.0, epoch=1).reason == Reason.STALE_EPOCH
