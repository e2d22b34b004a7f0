"""Goals on the wire: once per key, the newest alone, refused or previewed before anything moves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotree.protocol.messages import GoalState, GoalStatus, ModeKind, Reason, Verb, WayRequest, WayStatus
from robotree.sim.firmware.goals import POINTS
from robotree.sim.testing import NAN, ArmBench, RoverBench

AWAY = (0.35, -0.25, 0.35, 0.5)


@pytest.mark.parametrize(
    ("verb", "args", "reason"),
    [
        (Verb.GO_TO, (0.9, 0.0, 0.2, 0.0), Reason.OUT_OF_REACH),
        (Verb.GO_TO, (0.4, 0.0, 0.0, 0.0), Reason.OUT_OF_REACH),
        (Verb.GO_TO, (0.05, 0.0, 0.3, 0.0), Reason.OUT_OF_REACH),
        (Verb.GO_TO, (0.161, 0.0, 0.17, 0.0), Reason.PATH_BLOCKED),
        (Verb.GO_TO, (math.inf, 0.0, 0.2, 0.0), Reason.BAD_ARGUMENT),
        (Verb.GO_TO, (0.4, 0.0, 0.2, -math.inf), Reason.BAD_ARGUMENT),
        (Verb.GO_TO, (0.4, 0.0, 0.2, 0.0, 0.0), Reason.BAD_ARGUMENT),
        (Verb.GO_TO, (0.4, 0.0, 0.2, 0.0, 9.0), Reason.BAD_ARGUMENT),
        (Verb.GO_TO, (1e30, 0.0, 0.2, 0.0), Reason.OUT_OF_REACH),
        (Verb.GRIP, (-0.01,), Reason.BAD_ARGUMENT),
        (Verb.GRIP, (0.2,), Reason.BAD_ARGUMENT),
        (Verb.MOVE, (0.1, 0.0), Reason.UNKNOWN_VERB),
        (777, (), Reason.UNKNOWN_VERB),
    ],
)
def test_what_cannot_be_done_is_refused_before_it_moves(
    arm: ArmBench, verb: int, args: tuple[float, ...], reason: Reason
) -> None:
    before = arm.world.arm.state().q
    status = arm.operator.do(verb, *args)
    assert (status.state, status.reason) == (GoalState.REFUSED, reason)
    assert status.text
    arm.operator.wait(0.5)
    np.testing.assert_allclose(arm.world.arm.state().q, before, atol=1e-4)
    states = [message.state for _, message in arm.operator.heard if isinstance(message, GoalStatus)]
    assert GoalState.ACTIVE not in states


def test_nan_means_as_it_is_now(arm: ArmBench) -> None:
    before = arm.world.arm.state()
    arm.operator.succeed(Verb.GO_TO, 0.30, NAN, NAN, NAN)
    after = arm.world.arm.state()
    np.testing.assert_allclose(after.position, (0.30, before.position[1], before.position[2]), atol=0.003)
    assert after.twist == pytest.approx(before.twist, abs=0.01)


def test_a_newer_goal_takes_the_place_of_the_older_without_a_jerk(arm: ArmBench) -> None:
    operator = arm.operator
    older = operator.ask(Verb.GO_TO, *AWAY)
    operator.wait(0.8)
    newer = operator.ask(Verb.GO_TO, 0.4, 0.2, 0.3, 0.0)
    speeds = []
    for _ in range(40):
        operator.step()
        speeds.append(float(np.abs(arm.world.cell.data.qacc[:6]).max()))
    superseded = operator.status_of(older)
    assert (superseded.state, superseded.reason) == (GoalState.CANCELLED, Reason.SUPERSEDED)
    assert operator.end_of(newer).state == GoalState.SUCCEEDED
    assert max(speeds) < 15.0
    np.testing.assert_allclose(arm.world.arm.state().position, (0.4, 0.2, 0.3), atol=0.004)


def preview(bench: ArmBench | RoverBench, verb: Verb, *args: float) -> WayStatus:
    bench.operator.say(WayRequest(7, (*args, *[NAN] * (7 - len(args))), verb, 1, 1))
    bench.operator.until(
        lambda: any(isinstance(message, WayStatus) for _, message in bench.operator.heard), within=1.0
    )
    status = bench.operator.latest(WayStatus)
    bench.operator.heard.clear()
    return status


def test_the_way_leads_from_the_tool_to_the_goal_and_nothing_moves(arm: ArmBench) -> None:
    before = arm.world.arm.state().position
    told = preview(arm, Verb.GO_TO, 0.35, 0.1, 0.3, 0.0, 0.2)
    arm.operator.wait(0.5)
    np.testing.assert_allclose(arm.world.arm.state().position, before, atol=1e-3)
    assert (told.reason, told.count, told.number) == (Reason.NONE, POINTS, 7)
    np.testing.assert_allclose((told.x[0], told.y[0], told.z[0]), before, atol=3e-3)
    np.testing.assert_allclose((told.x[-1], told.y[-1], told.z[-1]), (0.35, 0.1, 0.3), atol=1e-6)
    assert told.duration > 0.5


@pytest.mark.parametrize(
    ("goal", "reason", "words"),
    [
        ((0.9, 0.0, 0.3), Reason.OUT_OF_REACH, "no posture brings the tool there"),
        ((0.3, 0.0, 0.01), Reason.OUT_OF_REACH, "for the table"),
        ((0.05, 0.05, 0.3), Reason.OUT_OF_REACH, "from the base"),
        ((math.inf, 0.0, 0.3), Reason.BAD_ARGUMENT, "is infinite"),
    ],
)
def test_what_a_goal_is_refused_its_preview_is_refused_in_the_same_words(
    arm: ArmBench, goal: tuple[float, ...], reason: Reason, words: str
) -> None:
    told = preview(arm, Verb.GO_TO, *goal, 0.0, 0.2)
    assert (told.reason, told.count) == (reason, 0)
    assert words in told.text
    status = arm.operator.do(Verb.GO_TO, *goal, 0.0, 0.2)
    assert (status.state, status.reason, status.text) == (GoalState.REFUSED, reason, told.text)


def test_a_stop_refuses_a_preview_too(arm: ArmBench) -> None:
    arm.operator.set_mode(ModeKind.SAFE_STOP)
    arm.operator.wait(0.1)
    told = preview(arm, Verb.GO_TO, 0.35, 0.1, 0.3, 0.0, 0.2)
    assert (told.reason, told.text) == (Reason.STOPPED, "A safe stop is in force; release it first.")


def test_a_verb_without_a_way_is_checked_all_the_same(arm: ArmBench) -> None:
    assert (preview(arm, Verb.GRIP, 0.02).reason, preview(arm, Verb.GRIP, 0.02).count) == (Reason.NONE, 0)
    assert preview(arm, Verb.GRIP, 1.0).reason == Reason.BAD_ARGUMENT
    assert preview(arm, Verb.DRIVE, 1.0).reason == Reason.UNKNOWN_VERB


def test_a_rover_goes_to_a_place_and_says_before_how(rover: RoverBench) -> None:
    told = preview(rover, Verb.GO_TO, 0.5, -0.4, NAN, NAN, 0.5)
    assert (told.x[-1], told.y[-1]) == pytest.approx((0.5, -0.4))
    told = preview(rover, Verb.MOVE, 0.2, -0.1, 0.5)
    assert (told.x[-1], told.y[-1]) == pytest.approx((0.2, -0.1))
    assert preview(rover, Verb.GO_TO, 1.6, 0.0, NAN, NAN, 0.5).reason == Reason.OUT_OF_REACH
    rover.operator.succeed(Verb.GO_TO, 0.5, -0.4, NAN, NAN, 0.5)
    assert rover.world.rover.state().position.tolist() == pytest.approx((0.5, -0.4), abs=5e-3)
