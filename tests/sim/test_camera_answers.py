"""A camera component answers what a ground station asks it; pymavlink reads the answers."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from robotree.protocol.frame import encode
from robotree.protocol.messages import CommandAck, CommandLong, MavCmd, MavResult, Mode, ModeKind
from robotree.sim.testing import ArmBench

CELL, WRIST = 100, 101


def ask(arm: ArmBench, component: int, command: int, first: float) -> list[Any]:
    """Command one component; what the controller says to it, as pymavlink reads the bytes."""
    arm.operator.wait(0.05)
    arm.operator.order(MavCmd.REQUEST_PROTOCOL_VERSION)  # nothing of it is from a camera
    arm.operator.say(CommandLong(1, component, command, 0, first, *(0.0,) * 6))
    arm.operator.carry()
    reader = common.MAVLink(None)
    said = [each for _ in range(5) for each in arm.controller.advance() if each.component in {CELL, WRIST}]
    frames = [encode(each.message, sequence=0, system=1, component=each.component) for each in said]
    return [message for raw in frames for message in reader.parse_buffer(bytearray(raw))]


@pytest.mark.parametrize(("component", "name"), [(CELL, b"cell"), (WRIST, b"arm/wrist")])
def test_a_camera_says_which_it_is(arm: ArmBench, component: int, name: bytes) -> None:
    ack, told = ask(arm, component, MavCmd.REQUEST_MESSAGE, 259)
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 512, MavResult.ACCEPTED)
    assert (told.get_type(), told.get_srcComponent()) == ("CAMERA_INFORMATION", component)
    assert bytes(told.model_name) == name.ljust(32, b"\0")
    assert bytes(told.vendor_name).rstrip(b"\0") == b"robotree"
    assert (told.flags, told.resolution_h, told.cam_definition_uri) == (0, 0, "")
    assert told.focal_length != told.focal_length, "NaN: unknown"


def test_a_camera_says_that_it_is_there(arm: ArmBench) -> None:
    ack, told = ask(arm, WRIST, MavCmd.REQUEST_MESSAGE, 0)
    assert ack.result == MavResult.ACCEPTED
    assert (told.type, told.autopilot) == (common.MAV_TYPE_CAMERA, common.MAV_AUTOPILOT_INVALID)


def test_a_camera_denies_a_message_that_it_does_not_have(arm: ArmBench) -> None:
    (ack,) = ask(arm, WRIST, MavCmd.REQUEST_MESSAGE, 148)
    assert ack.result == MavResult.DENIED


def test_a_command_to_a_camera_moves_nothing_and_stops_nothing(arm: ArmBench) -> None:
    (ack,) = ask(arm, WRIST, MavCmd.COMPONENT_ARM_DISARM, 0)
    assert ack.result == MavResult.UNSUPPORTED
    arm.operator.wait(0.6)
    assert arm.operator.latest(Mode).mode == ModeKind.READY


def test_the_autopilot_alone_answers_for_all_components(arm: ArmBench) -> None:
    assert ask(arm, 0, MavCmd.REQUEST_MESSAGE, 0) == []
    assert ask(arm, 99, MavCmd.REQUEST_MESSAGE, 0) == []
    assert all(ack.result == MavResult.ACCEPTED for ack in arm.operator.all(CommandAck))
