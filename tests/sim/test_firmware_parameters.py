"""Parameters of the running robots: read in every way, set within their limits, and obeyed."""

from __future__ import annotations

import numpy as np
import pytest

from robotree.protocol.messages import (
    GoalState,
    MavParamType,
    Mode,
    ParamSet,
    ParamValue,
    Reason,
    Verb,
)
from robotree.sim.testing import ArmBench, Operator, RoverBench

AWAY = (0.35, -0.25, 0.35, 0.5)


def tell(operator: Operator, name: str, value: float, kind: int = MavParamType.REAL32) -> None:
    operator.say(ParamSet(1, 1, name, value, kind))
    operator.wait(0.05)


def test_a_change_is_obeyed_and_told_to_everyone(arm: ArmBench) -> None:
    other = arm.operator.another()
    other.wait(0.05)
    tell(arm.operator, "TOOL_SPEED", 0.05)
    for each in (arm.operator, other):
        (told,) = each.all(ParamValue)
        assert (told.param_id, told.param_value) == ("TOOL_SPEED", pytest.approx(0.05))
    began = arm.operator.now
    arm.operator.succeed(Verb.GO_TO, *AWAY)
    slowly = arm.operator.now - began
    tell(arm.operator, "TOOL_SPEED", 0.2)
    began = arm.operator.now
    arm.operator.succeed(Verb.GO_TO, 0.35, 0.25, 0.35, 0.5)
    assert slowly > 1.5 * (arm.operator.now - began)


@pytest.mark.parametrize("stiffness", [250.0, 1000.0])
def test_a_stiffer_arm_yields_less_and_still_reaches_its_goals(arm: ArmBench, stiffness: float) -> None:
    tell(arm.operator, "TOOL_STIFFNESS", stiffness)
    arm.operator.succeed(Verb.GO_TO, *AWAY)
    arm.operator.wait(2.0)
    before = arm.world.arm.state().position
    arm.world.cell.data.xfrc_applied[arm.world.cell.model.body("arm/hand").id, 0] = 10.0
    arm.operator.wait(4.0)
    moved = arm.world.arm.state().position[0] - before[0]
    assert moved == pytest.approx(10.0 / stiffness, abs=0.0015)


def test_tuning_a_taut_spring_does_not_make_the_arm_jump(arm: ArmBench) -> None:
    arm.world.cell.data.xfrc_applied[arm.world.cell.model.body("arm/hand").id, 0] = 10.0
    arm.operator.wait(3.0)
    tell(arm.operator, "TOOL_STIFFNESS", 1000.0)
    fastest = 0.0
    for _ in range(300):
        arm.operator.step()
        fastest = max(fastest, float(np.abs(arm.world.cell.data.qvel[:6]).max()))
    assert fastest < 0.2


def test_a_weaker_grip_holds_with_less(arm: ArmBench) -> None:
    tell(arm.operator, "GRIP_FORCE", 4.0)
    arm.operator.succeed(Verb.GRIP, 0.07)
    arm.operator.succeed(Verb.GO_TO, 0.279, 0.10, 0.321, np.pi / 2)
    arm.operator.succeed(Verb.GO_TO, 0.279, 0.10, 0.221, np.pi / 2, 0.05)
    arm.operator.succeed(Verb.GRIP, 0.0)
    arm.operator.wait(0.5)
    assert 2.0 < arm.world.arm.state().grip_force <= 4.001


def test_a_lowered_top_speed_refuses_faster_goals(rover: RoverBench) -> None:
    tell(rover.operator, "BASE_SPEED_MAX", 0.3)
    refused = rover.operator.do(Verb.MOVE, 0.1, 0.0, 0.5)
    assert (refused.state, refused.reason) == (GoalState.REFUSED, Reason.BAD_ARGUMENT)
    rover.operator.succeed(Verb.MOVE, 0.1, 0.0)


def test_the_patience_of_the_link_can_be_tuned(rover: RoverBench) -> None:
    tell(rover.operator, "LINK_SILENCE", 0.5)
    assert rover.operator.latest(Mode).silence_ms == 500
    running = rover.operator.ask(Verb.MOVE, 1.0, 0.0, 0.05)
    rover.operator.wait(0.1)
    rover.operator.silent = True
    assert rover.operator.end_of(running, within=0.7).reason == Reason.LINK_SILENT
