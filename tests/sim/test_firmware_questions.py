"""What ground stations ask first, each answered on the link that asks; and rates that are each link's own."""

from __future__ import annotations

import pytest

from robotree.protocol.messages import (
    AutopilotVersion,
    CommandAck,
    ControlStatus,
    Gripper,
    Heartbeat,
    Joints,
    MavCmd,
    MavProtocolCapability,
    MavResult,
    Message,
    MissionCount,
    MissionRequestList,
    NamedValueFloat,
    Ping,
    ProtocolVersion,
    RequestDataStream,
    SysStatus,
    SystemTime,
    Tool,
)
from robotree.protocol.messages.base import M
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
