"""Parameters of the running robots: read in every way, set within their limits, and obeyed."""

from __future__ import annotations

import numpy as np
import pytest

from robotree.protocol.messages import (
    GoalState,
    MavCmd,
    MavParamError,
    MavParamType,
    Mode,
    ParamError,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Reason,
    Verb,
)
from robotree.sim.arm.tuning import PARAMETERS, ArmTuning
from robotree.sim.rover.device import PARAMETERS as ROVER_PARAMETERS
from robotree.sim.rover.device import RoverTuning
from robotree.sim.testing import ArmBench, Operator, RoverBench

AWAY = (0.35, -0.25, 0.35, 0.5)


def tell(operator: Operator, name: str, value: float, kind: int = MavParamType.REAL32) -> None:
    operator.say(ParamSet(1, 1, name, value, kind))
    operator.wait(0.05)


@pytest.mark.parametrize(
    ("parameters", "tuning"), [(PARAMETERS, ArmTuning()), (ROVER_PARAMETERS, RoverTuning())]
)
def test_every_parameter_is_a_number_of_the_robot_within_its_own_limits(
    parameters: tuple[object, ...], tuning: object
) -> None:
    for each in parameters:
        assert each.lower <= each.read(tuning) <= each.upper  # type: ignore[attr-defined]
    assert len({each.name for each in parameters}) == len(parameters)  # type: ignore[attr-defined]


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


VALUES = {each.name: each.read(ArmTuning()) for each in PARAMETERS}


@pytest.mark.parametrize(
    ("name", "value", "kind", "error"),
    [
        ("NO_SUCH_THING", 1.0, 9, MavParamError.DOES_NOT_EXIST),
        ("TOOL_SPEED", 0.3, 9, MavParamError.VALUE_OUT_OF_RANGE),
        ("TOOL_SPEED", float("nan"), 9, MavParamError.VALUE_OUT_OF_RANGE),
        ("TOOL_FORCE_MAX", 1e30, 9, MavParamError.VALUE_OUT_OF_RANGE),
        ("TOOL_SPEED", 0.1, 6, MavParamError.TYPE_MISMATCH),
    ],
)
def test_what_cannot_be_set_is_an_error_at_once_and_changes_nothing(
    arm: ArmBench, name: str, value: float, kind: int, error: int
) -> None:
    tell(arm.operator, name, value, kind)
    (told,) = arm.operator.all(ParamError)
    assert (told.error, told.target_system, told.target_component) == (error, 255, 190)
    assert arm.world.arm.tuning == ArmTuning()
    values = [each.param_value for each in arm.operator.all(ParamValue)]
    assert values == [pytest.approx(VALUES[each]) for each in VALUES if each == name]


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


def test_who_is_not_in_control_reads_and_does_not_set(arm: ArmBench) -> None:
    other = arm.operator.another()
    arm.operator.command(MavCmd.REQUEST_OPERATOR_CONTROL, 1, 0)
    tell(other, "TOOL_SPEED", 0.1)
    assert other.all(ParamError)[-1].error == MavParamError.PERMISSION_DENIED
    other.say(ParamRequestRead(1, 1, "TOOL_SPEED", -1))
    other.wait(0.05)
    assert other.latest(ParamValue).param_value == pytest.approx(0.2)
