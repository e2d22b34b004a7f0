"""Parameters of the running robots: read in every way, set within limits, obeyed, and described by FTP."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from robotree.protocol.messages import (
    ComponentMetadata,
    GoalState,
    MavCmd,
    MavParamType,
    Mode,
    ParamRequestList,
    ParamSet,
    ParamValue,
    Reason,
    Verb,
    fields_of,
    make,
)
from robotree.protocol.services.files import CLIENTS, DATA, Files, Opcode, crc32
from robotree.protocol.services.peer import Peer
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
    arm.operator.wait(1.0)
    before = arm.world.arm.state().position
    arm.world.cell.data.xfrc_applied[arm.world.cell.model.body("arm/hand").id, 0] = 10.0
    arm.operator.wait(2.5)
    moved = arm.world.arm.state().position[0] - before[0]
    assert moved == pytest.approx(10.0 / stiffness, abs=0.0015)


def test_tuning_a_taut_spring_does_not_make_the_arm_jump(arm: ArmBench) -> None:
    arm.world.cell.data.xfrc_applied[arm.world.cell.model.body("arm/hand").id, 0] = 10.0
    arm.operator.wait(2.0)
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


FTP = "FILE_TRANSFER_PROTOCOL"
Answer = dict[str, Any]


def reader(bench: ArmBench | RoverBench) -> Callable[..., list[Answer]]:
    """Asks by FTP, and takes the answers apart."""

    def ask(
        opcode: int, data: bytes = b"", *, session: int = 0, offset: int = 0, size: int = 0
    ) -> list[Answer]:
        operator = bench.operator
        operator.wait(0.05)
        before = len(operator.heard)
        head = bytes((1, 0, session, opcode, size or len(data), 0, 0, 0)) + offset.to_bytes(4, "little")
        payload = (head + data).ljust(251, b"\0")
        operator.say(make(FTP, target_system=1, target_component=1, payload=payload))
        operator.wait(0.05)
        told = [each for _, each in operator.heard[before:] if each.codec.definition.name == FTP]
        return [_apart(fields_of(each)["payload"]) for each in told]  # type: ignore[arg-type]

    return ask


def _apart(payload: bytes) -> Answer:
    return {
        "sequence": payload[0],
        "session": payload[2],
        "opcode": payload[3],
        "data": payload[12:][: payload[4]],
        "complete": payload[6],
        "offset": int.from_bytes(payload[8:12], "little"),
    }


def fetch(ask: Callable[..., list[Answer]], uri: str, how: Opcode) -> bytes:
    """Read a file as stations do: open it, then read on from where the answers ended, until its end."""
    path = uri.removeprefix("mftp://").encode()
    (opened,) = ask(Opcode.OPEN_FILE_RO, path)
    size, content = int.from_bytes(opened["data"], "little"), b""
    while True:
        answers = ask(how, session=opened["session"], offset=len(content), size=DATA)
        assert [each["sequence"] for each in answers] == list(range(2, 2 + len(answers)))
        if answers[0]["opcode"] == Opcode.NAK:
            break
        assert [each["complete"] for each in answers][:-1] == [0] * (len(answers) - 1)
        for each in answers:
            assert each["offset"] == len(content)
            content += each["data"]
    assert answers[0]["data"] == b"\x06", "end of file"
    assert len(content) == size
    (checked,) = ask(Opcode.CALC_FILE_CRC32, path)
    assert int.from_bytes(checked["data"], "little") == crc32(content)
    return content


@pytest.mark.parametrize("how", [Opcode.READ_FILE, Opcode.BURST_READ_FILE])
def test_every_parameter_has_text_unit_and_limits(arm: ArmBench, rover: RoverBench, how: Opcode) -> None:
    for bench in (arm, rover):
        bench.operator.order(MavCmd.REQUEST_MESSAGE, 397)
        bench.operator.wait(0.05)
        told, ask = bench.operator.latest(ComponentMetadata), reader(bench)
        raw = fetch(ask, told.uri, how)
        assert crc32(raw) == told.file_crc
        (kind,) = json.loads(raw)["metadataTypes"]
        raw = fetch(ask, kind["uri"], how)
        assert (kind["type"], kind["fileCrc"]) == (1, crc32(raw))
        described = {each["name"]: each for each in json.loads(raw)["parameters"]}

        bench.operator.say(ParamRequestList(1, 1))
        bench.operator.wait(1.0)
        values = {each.param_id: each.param_value for each in bench.operator.all(ParamValue)}
        assert described.keys() == values.keys()
        for name, each in described.items():
            assert each["min"] <= each["default"] <= each["max"]
            assert each["default"] == pytest.approx(values[name])
            assert len(each["units"]) in range(1, 6)
            assert " " not in each["units"]
            assert len(each["shortDesc"]) > 10
        silence = described["LINK_SILENCE"]
        assert (silence["units"], silence["min"], silence["max"]) == ("s", 0.01, 3600)


def test_the_files_are_listed(arm: ArmBench) -> None:
    (told,) = reader(arm)(Opcode.LIST_DIRECTORY, b"/")
    names = [entry.partition(b"\t")[0] for entry in told["data"].split(b"\0") if entry]
    assert names == [b"Fgeneral.json", b"Fparameter.json"]


@pytest.mark.parametrize("path", [b"/../etc/passwd", b"/", b"@PARAM/param.pck", b"general.json\xff", b""])
def test_there_is_no_other_file(arm: ArmBench, path: bytes) -> None:
    (told,) = reader(arm)(Opcode.OPEN_FILE_RO, path)
    assert (told["opcode"], told["data"]) == (Opcode.NAK, b"\x0a")


def test_each_client_has_a_session_of_its_own_and_those_that_nobody_ends_are_bounded() -> None:
    files = Files({"a": b"a" * 300, "b": b"b"})

    def asked(peer: Peer, opcode: Opcode, data: bytes = b"") -> Answer:
        head = bytes((1, 0, 0, opcode, len(data) or DATA, 0, 0, 0)) + bytes(4)
        (told,) = files.answer(make(FTP, payload=(head + data).ljust(251, b"\0")), peer)
        return _apart(fields_of(told)["payload"])  # type: ignore[arg-type]

    first, *others = [Peer("link", 255, component) for component in range(1, CLIENTS + 2)]
    asked(first, Opcode.OPEN_FILE_RO, b"a")
    for peer in others[:-1]:
        asked(peer, Opcode.OPEN_FILE_RO, b"b")
        assert asked(peer, Opcode.READ_FILE)["data"] == b"b"
    assert asked(first, Opcode.READ_FILE)["data"] == b"a" * DATA
    asked(others[-1], Opcode.OPEN_FILE_RO, b"b")
    assert asked(first, Opcode.READ_FILE)["data"] == b"\x04", "it has to open it again"
    asked(others[0], Opcode.TERMINATE_SESSION)
    assert asked(others[0], Opcode.READ_FILE)["data"] == b"\x04"
