"""What a ground station asks for and a controller of ours does not have: it is told so, and does not wait."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    LegacySetMode,
    MavResult,
    Mode,
    ModeKind,
    fields_of,
    make,
)
from robotree.protocol.parser import Parser
from robotree.sim.testing import ArmBench

PX4_MISSION = 4 << 24 | 4 << 16
PX4_LOITER = 3 << 24 | 4 << 16
FILES = "FILE_TRANSFER_PROTOCOL"


def answers(arm: ArmBench, question: AnyMessage, name: str) -> list[dict[str, Any]]:
    arm.operator.wait(0.05)
    arm.operator.say(question)
    arm.operator.wait(0.05)
    return [fields_of(message) for _, message in arm.operator.heard if message.codec.definition.name == name]


def ftp(opcode: int, sequence: int = 7, session: int = 3, offset: int = 0) -> AnyMessage:
    head = bytes((sequence & 0xFF, sequence >> 8, session, opcode, 0, 0, 0, 0)) + offset.to_bytes(4, "little")
    return make(FILES, target_system=1, target_component=1, payload=head.ljust(251, b"\0"))


@pytest.mark.parametrize(
    ("opcode", "code", "data"),
    [
        (4, 129, b"\x0a"),  # there is no file without a name
        (3, 129, b"\x06"),  # nor so many
        (5, 129, b"\x04"),  # nor such a session
        (15, 129, b"\x04"),
        (6, 129, b"\x09"),  # and none can be changed
        (13, 129, b"\x09"),
        (99, 129, b"\x07"),
        (1, 128, b""),
        (2, 128, b""),
    ],
)
def test_a_request_for_what_is_no_file_is_refused_and_one_that_ends_sessions_succeeds(
    arm: ArmBench, opcode: int, code: int, data: bytes
) -> None:
    (answer,) = answers(arm, ftp(opcode, sequence=0xFFFF, offset=77), FILES)
    assert (answer["target_system"], answer["target_component"]) == (255, 190)
    head = bytes((0, 0, 3, code, len(data), opcode, 0, 0)) + (77).to_bytes(4, "little")
    assert answer["payload"] == (head + data).ljust(251, b"\0")


@pytest.mark.parametrize("opcode", [128, 129])
def test_the_answer_of_another_server_is_not_answered(arm: ArmBench, opcode: int) -> None:
    assert answers(arm, ftp(opcode), FILES) == []


@pytest.mark.parametrize(
    "name",
    [
        "MISSION_COUNT",
        "MISSION_CLEAR_ALL",
        "MISSION_REQUEST_INT",
        "MISSION_REQUEST",
        "MISSION_ITEM_INT",
        "MISSION_WRITE_PARTIAL_LIST",
    ],
)
@pytest.mark.parametrize("kind", [0, 1])
def test_missions_are_unsupported(arm: ArmBench, name: str, kind: int) -> None:
    question = make(name, target_system=1, target_component=1, mission_type=kind)
    (answer,) = answers(arm, question, "MISSION_ACK")
    assert (answer["target_system"], answer["target_component"]) == (255, 190)
    assert (answer["type"], answer["mission_type"]) == (3, kind), "MAV_MISSION_UNSUPPORTED"


def test_there_are_no_logs(arm: ArmBench) -> None:
    (entry,) = answers(arm, make("LOG_REQUEST_LIST", target_system=1, end=0xFFFF), "LOG_ENTRY")
    assert (entry["num_logs"], entry["last_log_num"], entry["size"]) == (0, 0, 0)
    (data,) = answers(arm, make("LOG_REQUEST_DATA", target_system=1, id=4, ofs=90, count=90), "LOG_DATA")
    assert (data["id"], data["ofs"], data["count"]) == (4, 90, 0), "the end of the log"


def test_an_extended_parameter_cannot_be_set(arm: ArmBench) -> None:
    asked = make("PARAM_EXT_SET", target_system=1, param_id="CAM_MODE", param_value="1", param_type=9)
    (answer,) = answers(arm, asked, "PARAM_EXT_ACK")
    assert (answer["param_id"], answer["param_value"], answer["param_type"]) == ("CAM_MODE", "1", 9)
    assert answer["param_result"] == 2, "PARAM_ACK_FAILED"


@pytest.mark.parametrize("request_", [0, 1], ids=["request", "release"])
@pytest.mark.parametrize("version", [0, 3])
def test_control_by_passkey_is_refused_as_pymavlink_reads_it(
    arm: ArmBench, request_: int, version: int
) -> None:
    asked = common.MAVLink_change_operator_control_message(1, request_, version, b"robot")
    (question,) = Parser().feed(bytes(asked.pack(common.MAVLink(None, srcSystem=255, srcComponent=190))))
    name = "CHANGE_OPERATOR_CONTROL_ACK"
    assert len(answers(arm, question.message, name)) == 1
    (answer,) = (each for _, each in arm.operator.heard if each.codec.definition.name == name)
    (told,) = common.MAVLink(None).parse_buffer(bytearray(encode(answer, sequence=0, system=1, component=1)))
    assert (told.gcs_system_id, told.control_request, told.ack) == (255, request_, 2)


def test_what_is_for_another_system_is_not_ours_to_answer(arm: ArmBench) -> None:
    for name in ("MISSION_CLEAR_ALL", "MISSION_COUNT", "LOG_REQUEST_LIST", FILES):
        arm.operator.say(make(name, target_system=9, target_component=1))
    arm.operator.say(make("CHANGE_OPERATOR_CONTROL", target_system=9))
    arm.operator.wait(0.05)
    names = {message.codec.definition.name for _, message in arm.operator.heard}
    assert not names & {"MISSION_ACK", "LOG_ENTRY", "CHANGE_OPERATOR_CONTROL_ACK", FILES}


@pytest.mark.parametrize(
    ("custom", "result", "mode"),
    [
        (4, MavResult.ACCEPTED, ModeKind.SAFE_STOP),
        (4 << 16, MavResult.ACCEPTED, ModeKind.SAFE_STOP),
        (3, MavResult.ACCEPTED, ModeKind.READY),
        (PX4_LOITER, MavResult.ACCEPTED, ModeKind.READY),
        (PX4_MISSION, MavResult.DENIED, ModeKind.READY),
        (1, MavResult.ACCEPTED, ModeKind.READY),
        (0, MavResult.DENIED, ModeKind.READY),
    ],
)
def test_the_old_message_for_a_mode_is_obeyed_and_answered(
    arm: ArmBench, custom: int, result: MavResult, mode: ModeKind
) -> None:
    arm.operator.wait(0.05)
    arm.operator.say(LegacySetMode(1, 1, custom))
    arm.operator.wait(0.05)
    (ack,) = arm.operator.all(CommandAck)
    assert (ack.command, ack.result) == (11, result)
    assert arm.operator.latest(Mode).mode == mode
