"""Our bytes are mavgen's bytes, for every message; what cannot be sent is refused in one sentence."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol import Frame, Parser, encode
from robotree.protocol.dialect import Definition, Field, by_name, definitions
from robotree.protocol.errors import InvalidMessage, UnknownMessage
from robotree.protocol.messages import (
    AnyMessage,
    EncapsulatedData,
    Goal,
    GoalStatus,
    Gripper,
    Heartbeat,
    Joints,
    NamedValueFloat,
    Statustext,
    Timesync,
    Tool,
    Untyped,
    definition_of,
    fields_of,
    make,
)
from robotree.protocol.messages.base import codec_of
from robotree.protocol.signing import EPOCH, UNITS, Key, Signer, SigningTime, StreamTable, Verifier
from robotree.protocol.testing import Reference, check_codec
from tests.protocol.golden import generate

if TYPE_CHECKING:
    from robotree.protocol.codec import Value


def test_every_message_has_the_bytes_of_the_reference(reference: Reference) -> None:
    assert check_codec(reference) == 4 * len(definitions())


def _number(kind: str, *, finite: bool) -> st.SearchStrategy[float]:
    if kind in ("float", "double"):
        return st.floats(width=32 if kind == "float" else 64, allow_nan=not finite, allow_infinity=not finite)
    bits = int("".join(filter(str.isdigit, kind)))
    signed = not kind.startswith("u")
    return st.integers(-(2 ** (bits - 1)) if signed else 0, 2 ** (bits - signed) - 1)


def _value(field: Field, *, finite: bool) -> st.SearchStrategy[Value]:
    if field.type == "char":
        return st.text(st.characters(min_codepoint=1, max_codepoint=126), max_size=field.length)
    if field.is_bytes:
        return st.binary(min_size=field.length, max_size=field.length)
    if field.length:
        numbers = _number(field.type, finite=finite)
        return st.lists(numbers, min_size=field.length, max_size=field.length).map(tuple)
    return _number(field.type, finite=finite)


@st.composite
def filled(draw: st.DrawFn) -> tuple[Definition, dict[str, Value]]:
    definition = draw(st.sampled_from(list(definitions().values())))
    finite = make(definition.name).finite
    return definition, {field.name: draw(_value(field, finite=finite)) for field in definition.fields}


ids = st.integers(0, 255)


@settings(max_examples=400, deadline=None)
@given(message=filled(), sequence=ids, system=ids, component=ids)
def test_any_values_have_the_bytes_of_the_reference(
    reference: Reference,
    message: tuple[Definition, dict[str, Value]],
    sequence: int,
    system: int,
    component: int,
) -> None:
    definition, values = message
    ours = make(definition.name, **values)
    frame = encode(ours, sequence=sequence, system=system, component=component)
    assert frame == reference(definition, values, sequence, system, component)
    (read,) = Parser().feed(frame)
    assert _same(fields_of(read.message), values)
    assert read.raw == frame


def _same(ours: dict[str, Value], theirs: dict[str, Value]) -> bool:
    return repr(ours) == repr(theirs)  # NaN is not equal to itself, but reads the same


def test_a_typed_message_comes_back_typed() -> None:
    sent = Tool(5, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, (32767, 0, 0, -1), 1)
    (frame,) = Parser().feed(encode(sent, sequence=300, system=9, component=100))
    assert isinstance(frame.message, Tool)
    assert frame.message.q == sent.q
    assert (frame.sequence, frame.system, frame.component) == (300 & 0xFF, 9, 100)
    assert (frame.name, frame.msgid, frame.version, frame.signed) == ("ROBOTREE_TOOL", 57601, 2, False)
    assert frame.message is frame.message
    assert "Tool(" in repr(frame)


def test_a_message_without_a_class_is_read_by_the_names_of_its_fields() -> None:
    sent = make("ATTITUDE", roll=0.5, yawspeed=-1.0)
    (frame,) = Parser().feed(encode(sent, sequence=0, system=1, component=1))
    assert isinstance(frame.message, Untyped)
    assert frame.message["roll"] == 0.5
    assert definition_of(frame.message).name == "ATTITUDE"
    assert frame.message == sent


@given(key=st.integers(0, 2**64 - 1), args=st.tuples(*[st.floats(width=32)] * 7))
def test_zeros_at_the_end_are_left_out_and_come_back(key: int, args: tuple[float, ...]) -> None:
    sent = Goal(key, 0, 0, args, 0, 0, 0)
    frame = encode(sent, sequence=0, system=1, component=1)
    assert frame[-3] != 0 or len(frame) == 13
    assert Goal.codec.content(Frame.of(sent).message) == Goal.codec.content(sent)  # type: ignore[arg-type]  # a Goal


def test_an_empty_message_still_carries_one_byte() -> None:
    frame = encode(Heartbeat(0, 0, 0, 0, 0, 0), sequence=0, system=1, component=1)
    assert frame[1] == 1
    assert len(frame) == 13


def test_a_longer_payload_than_we_know_is_a_newer_dialect() -> None:
    codec = codec_of(0)
    frame = bytes((0xFD, 12, 0, 0, 7, 1, 1, 0, 0, 0)) + bytes(range(1, 13))
    frame += mcrf4xx(frame[1:] + codec.crc_extra).to_bytes(2, "little")
    (read,) = Parser().feed(frame)
    assert read.message == Heartbeat(5, 6, 7, 0x04030201, 8, 9)
    assert read.raw == frame


NAN, ZEROS = math.nan, (0.0,) * 8


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (Joints(0, (0.0,) * 7, 7), "position"),
        (Joints(0, (0.0,) * 9, 7), "position"),
        (Joints(-1, ZEROS, 7), "time_boot_ms"),
        (Joints(2**32, ZEROS, 7), "time_boot_ms"),
        (Joints(0, ZEROS, 256), "count"),
        (Joints(0, (*ZEROS[:7], NAN), 7), "position"),
        (Joints(0, (*ZEROS[:7], math.inf), 7), "position"),
        (Gripper(0, 0.0, -math.inf, 0.0, 0), "commanded"),
        (Gripper(0, 1e39, 0.0, 0.0, 0), "width"),
        (Gripper(0, "wide", 0.0, 0.0, 0), "width"),  # type: ignore[arg-type]  # the mistake under test
        (Gripper(0, 0.0, 0.0, 0.0, 0.5), "state"),  # type: ignore[arg-type]  # the mistake under test
        (Tool(0, *(0.0,) * 9, (1, 2, 3), 0), "q"),
        (Tool(0, *(0.0,) * 9, (1, 2, 3, 40000), 0), "q"),
        (Goal(0, 0, 0, (0.0,) * 6, 0, 0, 0), "args"),
        (GoalStatus(1, 1, 0.0, 0, 0, 0, 0, 0, "x" * 81), "text"),
        (NamedValueFloat(0, "eleven long", 0.0), "name"),
        (EncapsulatedData(0, bytes(254)), "data"),
        (Statustext(0, "ä" * 26), "text"),
        (Untyped(30, (0,) * 6), "*"),
        (Untyped(76, (0,) * 10), "*"),
        (Joints(0, 7.0, 1), "*"),  # type: ignore[arg-type]  # the mistake under test
        (EncapsulatedData(0, 7), "*"),  # type: ignore[arg-type]  # the mistake under test
        (make("ATTITUDE", roll="x"), "roll"),
        (make("ACTUATOR_CONTROL_TARGET", controls=(0.0,) * 9), "controls"),
    ],
)
def test_a_value_that_its_field_cannot_hold_is_refused(message: AnyMessage, field: str) -> None:
    with pytest.raises(InvalidMessage, match="correct the value before sending") as refused:
        encode(message, sequence=0, system=1, component=1)
    assert refused.value.field == field
    assert refused.value.message == definition_of(message).name


def test_nan_in_a_goal_means_as_it_is_now() -> None:
    sent = Goal(1, 0, 0, (NAN,) * 7, 1, 1, 1)
    (frame,) = Parser().feed(encode(sent, sequence=0, system=1, component=1))
    assert isinstance(frame.message, Goal)
    assert all(map(math.isnan, frame.message.args))


@pytest.mark.parametrize(("system", "component"), [(256, 1), (1, -1)])
def test_a_speaker_without_a_byte_is_refused(system: int, component: int) -> None:
    with pytest.raises(InvalidMessage, match="system and component"):
        encode(Timesync(0, 0), sequence=0, system=system, component=component)


def test_unknown_names_ids_and_fields_are_refused() -> None:
    with pytest.raises(UnknownMessage, match="NOBODY"):
        make("NOBODY")
    with pytest.raises(UnknownMessage, match="58000"):
        encode(Untyped(58000, ()), sequence=0, system=1, component=1)
    with pytest.raises(InvalidMessage, match="it has type, autopilot"):
        make("HEARTBEAT", colour=1)


def test_messages_are_values() -> None:
    assert Timesync(1, 2) == Timesync(1, 2)
    assert Frame.of(Timesync(1, 2)) == Frame.of(Timesync(1, 2))
    assert hash(Frame.of(Timesync(1, 2))) == hash(Frame.of(Timesync(1, 2)))
    with pytest.raises(AttributeError):
        Timesync(1, 2).tc1 = 3  # type: ignore[misc]  # the mistake under test


@pytest.mark.parametrize(
    ("message", "target"),
    [
        (Goal(1, 0, 0, (0.0,) * 7, 1, 4, 5), (4, 5)),
        (make("COMMAND_LONG", target_system=7, target_component=8), (7, 8)),
        (Timesync(1, 2), (0, 0)),
        (make("ATTITUDE"), (0, 0)),
    ],
)
def test_a_frame_knows_whom_it_is_for(message: AnyMessage, target: tuple[int, int]) -> None:
    frame = Frame.of(message)
    assert frame.target == target
    assert frame.is_for(target[0] or 9, target[1] or 9)
    assert frame.is_for(99, 99) == (target == (0, 0))


def test_names_and_ids_tell_the_same_messages() -> None:
    assert {each.id for each in by_name().values()} == set(definitions())


GOLDEN = Path(__file__).with_name("golden")
FRAMES: list[dict[str, Any]] = [
    json.loads(line) for line in (GOLDEN / "frames.jsonl").read_text().splitlines()
]


def _time() -> SigningTime:
    moment = EPOCH + generate.TIMESTAMP / UNITS
    return SigningTime(lambda: moment - 1, persisted=generate.TIMESTAMP - 1)


def _plain(message: Any) -> dict[str, Any]:
    fields = fields_of(message).items()
    return {name: list(value) if isinstance(value, tuple | bytes) else value for name, value in fields}


@pytest.mark.parametrize(
    "golden", FRAMES, ids=[f"{one['name']}{' signed' * one['signed']}" for one in FRAMES]
)
def test_a_golden_frame_is_read_and_written_the_same(golden: dict[str, Any]) -> None:
    raw, key = bytes.fromhex(golden["hex"]), Key(generate.SECRET)
    verifier = Verifier(key, _time(), StreamTable()) if golden["signed"] else None
    (frame,) = Parser(verifier).feed(raw)
    assert frame.signed is golden["signed"]
    assert (frame.system, frame.component) == (1, 190)
    assert _plain(frame.message) == golden["fields"]

    definition = by_name()[golden["name"]]
    fields = {field.name: field for field in definition.fields}
    values = [
        value if not isinstance(value, list) else bytes(value) if fields[name].is_bytes else tuple(value)
        for name, value in golden["fields"].items()
    ]
    message = codec_of(definition.id).build(*values)
    signer = Signer(key, _time(), generate.LINK_ID) if golden["signed"] else None
    again = encode(message, sequence=definition.id % 256, system=1, component=190, signer=signer)
    assert again.hex() == golden["hex"]


def test_the_file_is_what_the_reference_writes_today(oracle: ModuleType) -> None:
    advice = "run `python -m tests.protocol.golden.generate` and look at the diff"
    assert (GOLDEN / "frames.jsonl").read_text().splitlines() == [*generate.lines(oracle)], advice


def test_every_message_of_ours_is_in_the_file() -> None:
    ours = {each.name for each in definitions().values() if each.id in generate.OURS}
    assert ours
    assert ours <= {frame["name"] for frame in FRAMES}
