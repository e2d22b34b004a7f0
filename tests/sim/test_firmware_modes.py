"""Stopping, holding, being silent: no release undoes a later stop; and how often the controller speaks."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development

from robotree.protocol import Frame
from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    AnyMessage,
    AvailableModes,
    CommandAck,
    CommandInt,
    CommandLong,
    ControlStatus,
    CurrentMode,
    GoalState,
    GoalStatus,
    Gripper,
    Heartbeat,
    Joints,
    MavCmd,
    MavModeFlag,
    MavResult,
    MavType,
    Mode,
    ModeKind,
    NamedValueFloat,
    Reason,
    SetMode,
    Setpoint,
    SetpointKind,
    Statustext,
    Timesync,
    Tool,
    Verb,
)
from robotree.sim.controller.controller import Inbox, Received
from robotree.sim.firmware import Firmware
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.testing import NAN, ArmBench, Operator, RoverBench
from tests.world.realm import Cart

AWAY = (0.35, -0.25, 0.35, 0.5)


def test_a_stopped_arm_keeps_what_it_holds(arm: ArmBench) -> None:
    operator = arm.operator
    operator.succeed(Verb.GRIP, 0.07)
    operator.succeed(Verb.GO_TO, 0.279, 0.10, 0.321, math.pi / 2)
    operator.succeed(Verb.GO_TO, 0.279, 0.10, 0.221, math.pi / 2, 0.05)
    operator.succeed(Verb.GRIP, 0.0)
    operator.set_mode(ModeKind.SAFE_STOP)
    operator.wait(1.0)
    assert arm.world.arm.state().grip_force > 5.0


def test_a_stopped_arm_still_yields(arm: ArmBench) -> None:
    arm.operator.set_mode(ModeKind.SAFE_STOP)
    arm.operator.wait(1.0)
    before = arm.world.arm.state().position
    arm.world.cell.data.xfrc_applied[arm.world.cell.model.body("arm/hand").id, 0] = 10.0
    arm.operator.wait(2.5)
    assert arm.world.arm.state().position[0] - before[0] == pytest.approx(0.020, abs=0.001)


def test_the_arm_stands_within_100_ms_and_5_mm_of_a_hold_at_its_top_speed(arm: ArmBench) -> None:
    operator, watcher = arm.operator, arm.operator.another(system=77)
    operator.succeed(Verb.GO_TO, 0.45, -0.3, 0.35, 0.0, 0.25)
    operator.ask(Verb.GO_TO, 0.45, 0.3, 0.35, 0.0, 0.25)
    operator.wait(1.5)
    before = arm.world.arm.state().position
    operator.step()
    track = [began := arm.world.arm.state().position]
    assert np.linalg.norm(began - before) / 0.005 > 0.2, "[m/s] it is under way"
    operator.leave()
    for _ in range(60):
        watcher.step()
        track.append(arm.world.arm.state().position)
    way = [float(np.linalg.norm(place - began)) for place in track]
    steps = [float(np.linalg.norm(b - a)) / 0.005 for a, b in itertools.pairwise(track)]
    assert max(way) < 0.005
    assert max(steps[20:]) < 0.01, "[m/s] after 100 ms it neither moves on nor swings back"


def test_people_and_stations_are_told_of_a_stop(arm: ArmBench) -> None:
    for mode, armed in ((ModeKind.READY, MavModeFlag.SAFETY_ARMED), (ModeKind.SAFE_STOP, 0)):
        arm.operator.set_mode(mode)
        arm.operator.wait(0.1)
        beats = [beat for beat in arm.operator.all(Heartbeat) if beat.type != MavType.CAMERA]
        assert beats[-1].base_mode & MavModeFlag.SAFETY_ARMED == armed
    assert any("Safe stop" in text.text for text in arm.operator.all(Statustext))


def test_it_says_in_each_heartbeat_that_it_is_a_simulation(arm: ArmBench, rover: RoverBench) -> None:
    for bench in (arm, rover):
        bench.operator.wait(3.0)
        beats = [beat for beat in bench.operator.all(Heartbeat) if beat.type != MavType.CAMERA]
        assert len(beats) >= 3
        assert all(beat.base_mode & MavModeFlag.HIL_ENABLED for beat in beats)


def test_telemetry_keeps_its_rates(arm: ArmBench) -> None:
    arm.operator.wait(6.0)
    counts = {
        kind: sum(isinstance(m, kind) for _, m in arm.operator.heard)
        for kind in (Joints, Tool, Gripper, NamedValueFloat, Mode, CurrentMode)
    }
    per_second = {kind: count / 6.0 for kind, count in counts.items()}
    assert per_second[Joints] == pytest.approx(50, rel=0.02)
    assert per_second[Tool] == pytest.approx(50, rel=0.02)
    assert per_second[Gripper] == pytest.approx(10, rel=0.05)
    assert per_second[NamedValueFloat] == pytest.approx(20, rel=0.05)
    assert per_second[Mode] == pytest.approx(2, rel=0.2)
    assert per_second[CurrentMode] == pytest.approx(0.5, rel=0.2)
    speakers = Counter(beat.type for beat in arm.operator.all(Heartbeat))
    assert speakers == {MavType.GENERIC: pytest.approx(6, abs=1), MavType.CAMERA: pytest.approx(12, abs=2)}


def test_the_tool_is_told_as_it_is(arm: ArmBench) -> None:
    arm.operator.succeed(Verb.GO_TO, *AWAY)
    arm.operator.wait(1.0)
    tool = arm.operator.latest(Tool)
    np.testing.assert_allclose((tool.x, tool.y, tool.z), AWAY[:3], atol=0.002)
    w, x, y, z = np.array(tool.q) / 32767
    assert math.hypot(w, x, y, z) == pytest.approx(1.0, abs=1e-3)
    assert math.atan2(-2 * (x * y - w * z), 1 - 2 * (x * x + z * z)) == pytest.approx(AWAY[3], abs=0.01)
    joints = arm.operator.latest(Joints)
    assert joints.count == 6
    np.testing.assert_allclose(joints.position[:6], arm.world.arm.state().q, atol=1e-3)
    values = {m.name: m.value for _, m in arm.operator.heard if isinstance(m, NamedValueFloat)}
    assert values["lever"] == pytest.approx(-0.787, abs=0.01)
    assert values["peak_f"] == 0.0


def test_the_controllers_clock_can_be_asked_for(arm: ArmBench) -> None:
    arm.operator.wait(3.0)
    arm.operator.say(Timesync(tc1=0, ts1=42))
    arm.operator.wait(0.1)
    answer = arm.operator.latest(Timesync)
    assert answer.ts1 == 42
    assert answer.tc1 == pytest.approx(3.0e9, abs=0.05e9)


def test_what_a_controller_repeats_goes_out_together() -> None:
    firmware = Firmware(Cart(lambda: 0.0, lambda _, __: None), (), system=1, mav_type=MavType.GROUND_ROVER)
    sent: dict[type[object], list[int]] = {Mode: [], Heartbeat: [], ControlStatus: []}
    for now in range(0, 20_000, 5):
        if now == 105:
            firmware.greet("a link", now)
        for each in firmware.tick(now):
            sent.get(type(each.message), []).append(now)
    modes, beats, controls = ([now for now in times if now > 2_000] for times in sent.values())
    assert beats == controls, "both sides wake up once for the two"
    assert set(beats) <= set(modes)
    assert len(modes) == pytest.approx(36, abs=1)
    assert len(beats) == pytest.approx(18, abs=1)


def test_a_station_is_told_the_modes_by_name_and_each_change_at_once(arm: ArmBench) -> None:
    reader = development.MAVLink(None)

    def asked(number: int) -> list[Any]:
        before = len(arm.operator.all(AvailableModes))
        arm.operator.order(MavCmd.REQUEST_MESSAGE, 435, number)
        arm.operator.wait(0.05)
        told = arm.operator.all(AvailableModes)[before:]
        raw = [encode(each, sequence=0, system=1, component=1) for each in told]
        return [message for each in raw for message in reader.parse_buffer(bytearray(each))]

    names = {each.custom_mode: each.mode_name for each in asked(0)}
    assert names == {1: "Ready", 2: "Moving", 3: "Hold", 4: "Safe stop"}
    (hold,) = asked(3)
    assert (hold.mode_index, hold.number_modes, hold.mode_name) == (3, 4, "Hold")
    assert asked(9) == []
    arm.operator.wait(0.1)
    told = len(arm.operator.all(CurrentMode))
    arm.operator.order(MavCmd.COMPONENT_ARM_DISARM, 0.0)
    arm.operator.wait(0.1)
    assert [each.custom_mode for each in arm.operator.all(CurrentMode)[told:]] == [ModeKind.SAFE_STOP]


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
