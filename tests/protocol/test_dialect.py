"""The dialect compiles to the table that is committed, and an XML that is wrong says so in one sentence."""

from __future__ import annotations

import inspect
import struct
from enum import EnumType
from pathlib import Path

import msgspec
import pytest

from robotree.protocol import messages
from robotree.protocol.dialect import by_name, definitions
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.dialect.__main__ import main
from robotree.protocol.dialect.table import TABLE
from robotree.protocol.errors import DialectError
from robotree.protocol.messages import TYPED

ONE_CAN_FD_FRAME = 50
HOT = ("ROBOTREE_JOINTS", "ROBOTREE_TOOL", "ROBOTREE_GRIPPER", "ROBOTREE_GOAL", "ROBOTREE_MODE")


def test_the_table_is_what_the_xml_says() -> None:
    assert TABLE.read_bytes() == compiler.dump(compiler.build()), "run python -m robotree.protocol.dialect"


def test_formats_lengths_and_offsets_agree() -> None:
    for each in definitions().values():
        assert struct.calcsize(each.format) == each.length
        assert 0 < each.minimum <= each.length <= 255
        for name, offset in (
            ("target_system", each.target_system),
            ("target_component", each.target_component),
        ):
            assert [field.offset for field in each.fields if field.name == name] == [offset] * (offset >= 0)


def test_our_ids_lie_in_our_range_and_our_names_begin_with_ours() -> None:
    for each in definitions().values():
        assert (57600 <= each.id < 57700) == each.name.startswith("ROBOTREE_")


@pytest.mark.parametrize("name", HOT)
def test_hot_messages_fit_one_can_fd_frame(name: str) -> None:
    assert by_name()[name].length <= ONE_CAN_FD_FRAME


def test_the_classes_have_the_fields_of_the_xml_in_its_order() -> None:
    ours = {each.id for each in definitions().values() if each.name.startswith("ROBOTREE_")}
    assert ours <= TYPED.keys()
    for msgid, kind in TYPED.items():
        definition = definitions()[msgid]
        assert list(kind.__struct_fields__) == [field.name for field in definition.fields]
        hints = inspect.get_annotations(kind, eval_str=True)
        for field in definition.fields:
            assert hints[field.name] == _python_type(field.type, field.length, is_bytes=field.is_bytes)


def _python_type(kind: str, length: int, *, is_bytes: bool) -> object:
    if kind == "char":
        return str
    if is_bytes:
        return bytes
    if kind in ("float", "double"):
        return tuple[float, ...] if length else float
    return tuple[int, ...] if length else int


def _enumerations() -> list[EnumType]:
    return [kind for kind in vars(messages).values() if isinstance(kind, EnumType)]


def test_our_enumerations_are_those_of_the_xml() -> None:
    declared = {enum.name: enum for file in compiler.parse() for enum in file.enum}
    ours = {name: enum for name, enum in declared.items() if name.startswith("ROBOTREE_")}
    ours_by_name = {_snake(kind.__name__): kind for kind in _enumerations()}
    for name, enum in ours.items():
        kind = ours_by_name[name.removeprefix("ROBOTREE_")]
        entries = {
            each.name.removeprefix(f"{name}_"): each.value for each in enum.entry if not each.end_marker
        }
        assert entries == {name: member.value for name, member in kind.__members__.items()}
    assert len(ours) >= 5


def test_the_parts_of_common_enumerations_have_their_values() -> None:
    declared = {enum.name: enum for file in compiler.parse() for enum in file.enum}
    common = [kind for kind in _enumerations() if kind.__module__.endswith(".common")]
    for kind in common:
        name = _snake(kind.__name__)
        (enum,) = (declared[each] for each in (name, f"MAVLINK_{name}") if each in declared)
        for member in kind.__members__.values():
            assert member.value in {
                each.value for each in enum.entry if each.name.endswith(f"_{member.name}")
            }
    assert len(common) >= 5


def _snake(name: str) -> str:
    return "".join(f"_{letter}" if letter.isupper() else letter.upper() for letter in name).lstrip("_")


def test_the_table_is_plain_data() -> None:
    decoded = msgspec.json.decode(TABLE.read_bytes())
    assert [each["id"] for each in decoded] == sorted(definitions())


FIELD = '<field type="uint8_t" name="a">A.</field>'


def _dialect(messages: str, *, include: str = "common.xml", enums: str = "") -> str:
    return (
        f'<?xml version="1.0"?><mavlink><include>{include}</include><dialect>0</dialect>'
        f"<enums>{enums}</enums><messages>{messages}</messages></mavlink>"
    )


def _message(fields: str, *, number: int = 57699, name: str = "PROBE") -> str:
    return f'<message id="{number}" name="{name}"><description>A probe.</description>{fields}</message>'


WRONG = {
    "id taken": _dialect(_message(FIELD, number=0)),
    "name taken": _dialect(_message(FIELD, name="HEARTBEAT")),
    "field twice": _dialect(_message(FIELD + FIELD)),
    "unknown type": _dialect(_message('<field type="complex" name="a">A.</field>')),
    "array too long": _dialect(_message('<field type="uint8_t[256]" name="a">A.</field>')),
    "payload too long": _dialect(_message('<field type="double[32]" name="a">A.</field>')),
    "missing include": _dialect(_message(FIELD), include="nowhere.xml"),
    "includes itself for ever": _dialect(_message(FIELD), include="nowhere/../../probe.xml"),
    "not XML": "<mavlink><messages>",
}


@pytest.mark.parametrize("case", WRONG)
def test_an_xml_that_is_wrong_is_refused_in_one_sentence(case: str, tmp_path: Path) -> None:
    xml = tmp_path / "probe.xml"
    xml.write_text(WRONG[case])
    with pytest.raises(DialectError, match="does not compile; correct the XML") as refused:
        compiler.build(xml)
    assert refused.value.path == str(xml)


@pytest.mark.parametrize("case", ["id taken", "name taken", "missing include", "not XML", "array too long"])
def test_the_generator_cannot_fail_silently(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    xml = tmp_path / "probe.xml"
    xml.write_text(WRONG[case])
    with pytest.raises(DialectError):
        compiler.generate(tmp_path / "out.py", xml=xml)
    assert capsys.readouterr().out == ""


def test_the_schema_of_mavlink_is_checked(tmp_path: Path) -> None:
    xml = tmp_path / "probe.xml"
    xml.write_text(_dialect(_message(FIELD, number=2**24)))
    with pytest.raises(DialectError, match="SystemExit"):
        compiler.generate(tmp_path / "out.py", xml=xml)


def test_the_dialect_compiles_for_wireshark(tmp_path: Path) -> None:
    compiler.generate(tmp_path / "robotree.lua", language="WLua")
    assert "ROBOTREE_GOAL" in (tmp_path / "robotree.lua").read_text()
    assert "WLua" in compiler.languages()


def test_regenerating_writes_the_committed_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "table.json"
    monkeypatch.setattr("robotree.protocol.dialect.__main__.TABLE", copy)
    assert main() == 0
    assert copy.read_bytes() == TABLE.read_bytes()
    assert capsys.readouterr().out == f"table.json: {len(definitions())} messages\n"


@pytest.mark.parametrize(
    ("name", "crc_extra"), [("COMMAND_CANCEL", 14), ("PROTOCOL_VERSION", 217), ("CONTROL_STATUS", 21)]
)
def test_what_we_take_from_upstream_is_understood_there(name: str, crc_extra: int) -> None:
    assert by_name()[name].crc_extra == crc_extra


def test_our_own_file_stands_alone() -> None:
    alone = {each.name for each in compiler.build(compiler.DIALECT.with_name("robotree.xml"))}
    assert {each for each in by_name() if each.startswith("ROBOTREE_")} <= alone
    assert "COMMAND_CANCEL" not in alone
