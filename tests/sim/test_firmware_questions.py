"""What ground stations ask is answered on the link that asks, and what is not there is told so."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    AnyMessage,
    AutopilotVersion,
    CommandAck,
    ControlStatus,
    Gripper,
    Heartbeat,
    Joints,
    LegacySetMode,
    MavCmd,
    MavProtocolCapability,
    MavResult,
    Message,
    MissionCount,
    MissionRequestList,
    Mode,
    ModeKind,
    NamedValueFloat,
    Ping,
    ProtocolVersion,
    RequestDataStream,
    SysStatus,
    SystemTime,
    Tool,
    fields_of,
    make,
)
from robotree.protocol.messages.base import M
from robotree.protocol.parser import Parser
from robotree.sim.testing import ArmBench, Operator


def msgid(kind: type[Message]) -> int:
    return kind.codec.definition.id


def ask_for(operator: Operator, kind: type[M]) -> M:
    assert operator.command(MavCmd.REQUEST_MESSAGE, msgid(kind)).result == MavResult.ACCEPTED
    operator.wait(0.02)
    return operator.latest(kind)


def rate(operator: Operator, kind: type[Message], seconds: float = 2.0) -> float:
    before = len(operator.all(kind))
    operator.wait(seconds)
    return (len(operator.all(kind)) - before) / seconds


def test_a_ping_comes_back_to_who_asked_and_to_nobody_else(arm: ArmBench) -> None:
    other = arm.operator.another()
    arm.operator.say(Ping(123, 7))
    arm.operator.wait(0.05)
    assert arm.operator.all(Ping) == [Ping(123, 7, 255, 190)]
    assert other.all(Ping) == []


def test_the_answer_to_a_ping_is_not_answered(arm: ArmBench) -> None:
    arm.operator.say(Ping(123, 7, 1, 1))
    arm.operator.wait(0.05)
    assert arm.operator.all(Ping) == []


@pytest.mark.parametrize("mission_type", [0, 1, 255])
def test_there_are_no_mission_items(arm: ArmBench, mission_type: int) -> None:
    arm.operator.say(MissionRequestList(1, 0, mission_type))
    arm.operator.wait(0.05)
    assert arm.operator.all(MissionCount) == [MissionCount(255, 190, 0, mission_type)]


def test_it_says_what_it_is_and_what_it_speaks(arm: ArmBench) -> None:
    version = ask_for(arm.operator, AutopilotVersion)
    assert version.uid != 0
    assert version.capabilities & MavProtocolCapability.MAVLINK2
    assert version.capabilities & MavProtocolCapability.FLIGHT_TERMINATION, "see test_firmware_commands"
    assert ask_for(arm.operator, ProtocolVersion).version == 200
    assert ask_for(arm.operator, SystemTime).time_boot_ms > 0
    assert ask_for(arm.operator, Heartbeat).autopilot == 0
    assert ask_for(arm.operator, ControlStatus).gcs_main == 0


@pytest.mark.parametrize(
    ("command", "kind"),
    [
        (MavCmd.REQUEST_AUTOPILOT_CAPABILITIES, AutopilotVersion),
        (MavCmd.REQUEST_PROTOCOL_VERSION, ProtocolVersion),
    ],
)
def test_it_can_be_asked_in_the_old_way(arm: ArmBench, command: int, kind: type[Message]) -> None:
    assert arm.operator.command(command, 1).result == MavResult.ACCEPTED
    arm.operator.wait(0.02)
    assert len(arm.operator.all(kind)) == 1


def test_all_instances_of_a_message_are_told(arm: ArmBench) -> None:
    arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, msgid(NamedValueFloat), -1)
    arm.operator.wait(0.1)
    arm.operator.heard.clear()
    ask_for(arm.operator, NamedValueFloat)
    assert [value.name for value in arm.operator.all(NamedValueFloat)] == ["lever", "peak_f"]


@pytest.mark.parametrize("unknown", [4711.0, -1.0, 1e30, float("nan"), float("inf")])
def test_what_it_cannot_tell_is_denied(arm: ArmBench, unknown: float) -> None:
    assert arm.operator.command(MavCmd.REQUEST_MESSAGE, unknown).result == MavResult.DENIED
    assert arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, unknown, 1e4).result == MavResult.DENIED


def test_a_command_that_nobody_knows_is_unsupported(arm: ArmBench) -> None:
    assert arm.operator.command(22).result == MavResult.UNSUPPORTED


def test_its_state_is_told_once_a_second(arm: ArmBench) -> None:
    arm.operator.wait(0.1)
    assert rate(arm.operator, SysStatus, 5.0) == pytest.approx(1.0, abs=0.21)
    assert arm.operator.latest(SysStatus).battery_remaining == -1


def test_the_rates_of_one_link_are_not_those_of_another(arm: ArmBench) -> None:
    other = arm.operator.another()
    arm.operator.wait(0.1)
    assert arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, msgid(Joints), 10_000).result == 0
    assert arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, msgid(Gripper), -1).result == 0
    heard = {kind: len(other.all(kind)) for kind in (Joints, Gripper)}
    assert rate(arm.operator, Joints) == pytest.approx(100, rel=0.02)
    assert rate(arm.operator, Gripper) == 0
    assert (len(other.all(Joints)) - heard[Joints]) / 4.0 == pytest.approx(50, rel=0.05)
    assert (len(other.all(Gripper)) - heard[Gripper]) / 4.0 == pytest.approx(10, rel=0.1)


def test_what_is_told_only_when_asked_can_be_told_regularly(arm: ArmBench) -> None:
    assert rate(arm.operator, SystemTime, 1.0) == 0
    arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, msgid(SystemTime), 100_000)
    assert rate(arm.operator, SystemTime) == pytest.approx(10, rel=0.1)


def test_rates_end_with_their_link(arm: ArmBench) -> None:
    other = arm.operator.another()
    other.command(MavCmd.SET_MESSAGE_INTERVAL, msgid(Tool), 5_000)
    other.leave()
    arm.operator.wait(0.02)
    assert other.far not in arm.controller.firmware._schedule.links


def test_the_old_way_to_ask_for_a_rate_does_no_harm(arm: ArmBench) -> None:
    arm.operator.say(RequestDataStream(1, 1, 0, 4, 1))
    assert rate(arm.operator, Tool) == pytest.approx(50, rel=0.05)
    assert not [ack for ack in arm.operator.all(CommandAck) if ack.result != MavResult.ACCEPTED]


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
