"""Goals on the wire: once per key, the newest alone, refused with the reason before anything moves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotree.protocol.messages import GoalState, GoalStatus, Reason, Verb
from robotree.sim.testing import NAN, ArmBench

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
