"""Set-points: the tool follows a stream smoothly, within its limits, and holds when the stream dries up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotree.protocol import Frame
from robotree.protocol.messages import (
    GoalState,
    MavParamType,
    ModeKind,
    ParamSet,
    Reason,
    Setpoint,
    SetpointKind,
    SysStatus,
    Tool,
    Verb,
)
from robotree.sim.arm.planner import LOWEST, NEAREST
from robotree.sim.testing import NAN, ArmBench, Operator, RoverBench

PERIOD = 0.02
"""[s] between two set-points."""


class Pilot:
    """Streams set-points as a joystick would."""

    def __init__(self, operator: Operator, kind: SetpointKind, *, epoch: int = 1, ttl: float = 0.2) -> None:
        self._operator, self._kind, self._epoch, self._ttl = operator, kind, epoch, ttl
        self._number = 0

    def say(self, *args: float, made: float = 0.0) -> None:
        self._number += 1
        padded = (*args, *(NAN,) * (7 - len(args)))
        ttl = round(1000 * self._ttl)
        self._operator.say(
            Setpoint(round(1000 * made), self._epoch, self._number, padded, ttl, 1, 1, self._kind)
        )

    def steer(self, seconds: float, *args: float) -> None:
        end = self._operator.now + seconds
        while self._operator.now < end:
            self.say(*args)
            self._operator.wait(PERIOD)


@pytest.fixture
def pose(arm: ArmBench) -> Pilot:
    return Pilot(arm.operator, SetpointKind.TOOL_POSE)


@pytest.fixture
def stick(arm: ArmBench) -> Pilot:
    return Pilot(arm.operator, SetpointKind.TOOL_VELOCITY)


def place(arm: ArmBench) -> np.ndarray:
    return arm.world.arm.state().position


def test_the_tool_goes_where_the_stream_says_and_the_mode_tells(arm: ArmBench, pose: Pilot) -> None:
    pose.steer(0.5, 0.35, -0.2, 0.35, 0.3)
    assert arm.operator.mode()[0] == ModeKind.ACTIVE
    assert arm.operator.latest(Tool).busy == 1
    pose.steer(2.5, 0.35, -0.2, 0.35, 0.3)
    np.testing.assert_allclose(place(arm), (0.35, -0.2, 0.35), atol=0.004)
    assert arm.world.arm.state().twist == pytest.approx(0.3, abs=0.02)


def test_it_follows_a_circle_without_a_jerk(arm: ArmBench, pose: Pilot) -> None:
    pose.steer(2.0, 0.40, 0.0, 0.30, 0.0)
    last, fastest, error = place(arm), 0.0, 0.0
    began = arm.operator.now
    while (t := arm.operator.now - began) < 4.0:
        angle = 0.8 * t
        pose.say(0.35 + 0.05 * math.cos(angle), 0.05 * math.sin(angle), 0.30, 0.0)
        arm.operator.wait(PERIOD)
        here = place(arm)
        fastest = max(fastest, float(np.linalg.norm(here - last)) / PERIOD)
        error = max(error, abs(math.dist(here, (0.35, 0.0, 0.30)) - 0.05))
        last = here
    assert fastest < 0.06, "the circle is walked at 0.04 m/s"
    assert error < 0.01


def test_it_holds_when_the_stream_dries_up(arm: ArmBench, stick: Pilot) -> None:
    stick.steer(1.0, 0.0, 0.1, 0.0, 0.0)
    assert arm.operator.mode()[0] == ModeKind.ACTIVE
    arm.operator.wait(0.3)
    assert arm.operator.mode()[0] == ModeKind.READY
    held = place(arm)
    arm.operator.wait(1.5)
    assert np.linalg.norm(place(arm) - held) < 0.01


def test_a_wish_for_more_speed_gets_the_highest_which_can_be_lowered_meanwhile(
    arm: ArmBench, stick: Pilot
) -> None:
    for highest in (0.25, 0.1):
        arm.operator.say(ParamSet(1, 1, "TOOL_SPEED_MAX", highest, MavParamType.REAL32))
        stick.steer(1.0, 0.0, 1e30, 0.0, 0.0)
        before = place(arm)
        stick.steer(0.3, 0.0, 1e30, 0.0, 0.0)
        assert np.linalg.norm(place(arm) - before) / 0.3 == pytest.approx(highest, rel=0.1)


@pytest.mark.parametrize("way", [(0, 0, -0.2), (-0.2, 0, 0), (0.2, 0, 0), (-0.2, 0, -0.2)])
def test_no_stream_leads_out_of_the_workspace(
    arm: ArmBench, stick: Pilot, way: tuple[float, float, float]
) -> None:
    stick.steer(3.2, *way, 0.0)
    x, y, z = place(arm).tolist()
    assert z > LOWEST - 0.005
    assert math.hypot(x, y) > NEAREST - 0.005
    assert arm.world.arm.state().peak_force == 0.0, "it has touched nothing"
    rest = place(arm)
    stick.steer(0.5, *way, 0.0)
    assert np.linalg.norm(place(arm) - rest) < 0.004, "it waits at the border"
    stick.steer(1.0, *(-0.5 * each for each in way), 0.0)
    assert np.linalg.norm(place(arm) - rest) > 0.03, "and comes back when it is led back"


def test_a_place_out_of_reach_is_dropped_and_counted(arm: ArmBench, pose: Pilot) -> None:
    pose.steer(0.1, 2.0, 0.0, 0.3, 0.0)
    arm.operator.wait(1.1)
    assert arm.operator.latest(SysStatus).errors_count4 == 5
    assert np.linalg.norm(place(arm) - arm.world.arm.state().position) < 0.001


@pytest.mark.parametrize(("waited", "mode"), [(0.15, ModeKind.ACTIVE), (0.25, ModeKind.READY)])
def test_what_does_not_say_when_it_was_made_is_as_old_as_its_wait_in_a_queue(
    rover: RoverBench, waited: float, mode: ModeKind
) -> None:
    rover.operator.wait(1.0)
    firmware, now = rover.controller.firmware, round(1000 * rover.operator.now)
    setpoint = Setpoint(0, 1, 1, (0.3, 0.0, *(NAN,) * 5), 200, 1, 1, SetpointKind.BASE_VELOCITY)
    frame = Frame.of(setpoint, system=254, component=190)
    firmware.receive(frame, "link", now, arrived=now - round(1000 * waited))
    assert firmware.mode == mode


def test_a_stop_ends_the_stream_and_its_release_does_not_bring_it_back(arm: ArmBench, stick: Pilot) -> None:
    stick.steer(0.5, 0.0, 0.1, 0.0, 0.0)
    arm.operator.set_mode(ModeKind.SAFE_STOP)
    stick.steer(1.0, 0.0, 0.1, 0.0, 0.0)
    assert arm.operator.mode()[0] == ModeKind.SAFE_STOP
    arm.operator.set_mode(ModeKind.READY)
    arm.operator.wait(0.1)
    held = place(arm)
    stick.steer(1.0, 0.0, 0.1, 0.0, 0.0)
    assert np.linalg.norm(place(arm) - held) < 0.005
    arm.operator.wait(2.5)
    stick.steer(1.0, 0.0, 0.1, 0.0, 0.0)
    assert place(arm)[1] - held[1] > 0.05, "after a pause it is a new stream"


def test_a_goal_ends_the_stream_and_is_not_disturbed_by_it(arm: ArmBench, stick: Pilot) -> None:
    stick.steer(0.5, 0.0, 0.1, 0.0, 0.0)
    goal = arm.operator.ask(Verb.GO_TO, 0.35, -0.2, 0.35, 0.0)
    stick.steer(3.5, 0.0, 0.1, 0.0, 0.0)
    assert arm.operator.end_of(goal).state == GoalState.SUCCEEDED
    np.testing.assert_allclose(place(arm), (0.35, -0.2, 0.35), atol=0.004)


def test_a_stream_whose_pilot_is_gone_ends_though_others_are_heard(arm: ArmBench, stick: Pilot) -> None:
    arm.operator.another(system=9)
    stick.steer(0.5, 0.0, 0.1, 0.0, 0.0)
    arm.operator.leave()
    arm.operator._crowd[0].wait(0.02)
    assert arm.operator._crowd[0].mode() == (ModeKind.HOLD, Reason.LINK_SILENT)


def test_joints_are_not_followed_by_an_arm_that_hangs_on_its_tool(arm: ArmBench) -> None:
    Pilot(arm.operator, SetpointKind.JOINTS).steer(0.5, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
    assert arm.operator.mode()[0] == ModeKind.READY


def test_the_rover_drives_with_a_velocity_and_not_off_its_floor(rover: RoverBench) -> None:
    stick = Pilot(rover.operator, SetpointKind.BASE_VELOCITY)
    stick.steer(2.0, 0.3, 0.0, 0.0)
    assert rover.world.rover.state().position[0] == pytest.approx(0.55, abs=0.1)
    stick.steer(9.0, 0.3, 0.0)
    assert rover.world.rover.state().position[0] < 1.5
    assert np.abs(rover.world.rover.state().velocity).max() < 0.005
    stick.steer(0.5, 0.3, 0.0, 1.0)
    assert rover.operator.mode()[0] == ModeKind.READY, "it does not turn, so that was no set-point"
