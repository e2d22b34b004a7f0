"""The dialect compiles to the table that is committed, and an XML that is wrong says so in one sentence."""

from __future__ import annotations

import re
import struct
import sys
from pathlib import Path

import msgspec
import pytest

from robotree.protocol import messages
from robotree.protocol.dialect import by_name, classes, definitions
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.dialect.__main__ import CLASSES, main
from robotree.protocol.dialect.extension import extend
from robotree.protocol.dialect.table import FIRST_OWN_ID, LARGEST_ID, TABLE
from robotree.protocol.errors import DialectError
from robotree.protocol.messages import TYPED
from robotree.protocol.testing import forgetting_messages
from tests.command_line import ran

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


def test_ids_for_robots_of_ones_own_are_given_to_no_message_of_ours_and_of_no_dialect_of_mavlink() -> None:
    files = [compiler.DIALECT, *compiler.base_directory().glob("*.xml")]
    given = {int(number) for file in files for number in re.findall(r'<message id="(\d+)"', file.read_text())}
    assert max(given | definitions().keys()) < FIRST_OWN_ID < LARGEST_ID


@pytest.mark.parametrize("name", HOT)
def test_hot_messages_fit_one_can_fd_frame(name: str) -> None:
    assert by_name()[name].length <= ONE_CAN_FD_FRAME


CRC_EXTRA = {
    "ROBOTREE_JOINTS": 162,
    "ROBOTREE_TOOL": 219,
    "ROBOTREE_GRIPPER": 140,
    "ROBOTREE_GOAL": 227,
    "ROBOTREE_GOAL_STATUS": 90,
    "ROBOTREE_GOAL_CANCEL": 232,
    "ROBOTREE_MODE": 172,
    "ROBOTREE_SET_MODE": 45,
    "ROBOTREE_PICTURE_REQUEST": 137,
    "ROBOTREE_SETPOINT": 51,
    "ROBOTREE_CLAIM": 68,
    "ROBOTREE_CLAIM_STATUS": 161,
    "ROBOTREE_SPEECH": 55,
    "ROBOTREE_TAGS": 108,
    "ROBOTREE_BASE_STATE": 54,
    "ROBOTREE_WAY_REQUEST": 44,
    "ROBOTREE_WAY_STATUS": 13,
    "ROBOTREE_SKELETON": 90,
    "ROBOTREE_CAMERA_POSE": 175,
}
"""Of our messages; another number means that older programs no longer understand us."""


def test_units_ranges_and_invalid_values_change_no_checksum() -> None:
    assert {
        each.name: each.crc_extra for each in compiler.build() if each.id in range(57600, 57700)
    } == CRC_EXTRA


def test_the_dialect_uses_no_unit_that_mavlink_does_not_know(tmp_path: Path) -> None:
    """The generator says it, as `mavgen --strict-units` does."""
    generator = [sys.executable, "-m", "pymavlink.tools.mavgen", "--strict-units", "--wire-protocol=2.0"]
    with compiler.workspace(compiler.DIALECT) as copy:
        said = ran([*generator, "--lang=Python3", f"--output={tmp_path / 'out.py'}", str(copy)])
    assert said.returncode == 0, said.stdout + said.stderr
    assert (tmp_path / "out.py").exists()


def test_the_classes_are_what_the_xml_says() -> None:
    generated = classes.source(compiler.parse())
    assert CLASSES.read_text(encoding="utf-8") == generated, "run python -m robotree.protocol.dialect"


def test_all_our_messages_and_those_that_are_listed_have_a_class() -> None:
    names = {definitions()[msgid].name for msgid in TYPED}
    assert names == {each for each in by_name() if each.startswith("ROBOTREE_")} | classes.MESSAGES.keys()


def test_a_class_has_the_units_the_enumerations_and_the_zeros_of_the_xml() -> None:
    """One message as its source must read, so that the generator and the test are not the same program."""
    generated = classes.source(compiler.parse())
    assert (
        '''@wire("ROBOTREE_GRIPPER")
class Gripper(Message, frozen=True, gc=False):
    """State of the gripper."""

    finite: ClassVar[bool] = True

    time_boot_ms: int
    """Controller time. [ms]"""
    width: float
    """Distance between the fingers. [m]"""
    commanded: float
    """Width asked for. [m]"""
    force: float
    """Force between the fingers [N]."""
    state: int | GripperState
    """State."""
'''
        in generated
    )
    assert messages.GoalStatus(1, 2, 0.5, 3, 0, 1, 1, 4).text == ""
    assert messages.Heartbeat(0, 0, 0, 0, 4).mavlink_version == 3
    assert messages.GoalState.SUCCEEDED.final
    assert not messages.GoalState.ACTIVE.final


def test_an_entry_that_the_base_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(classes.ENUMS, "MAV_STATE", ("States.", "BOOT ASLEEP"))
    with pytest.raises(KeyError, match="MAV_STATE has no ASLEEP"):
        classes.source(compiler.parse())


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


def _enum(entries: str, name: str = "PROBES", *, bitmask: str = "false") -> str:
    return _dialect(_message(FIELD), enums=f'<enum name="{name}" bitmask="{bitmask}">{entries}</enum>')


def _typed(kind: str, name: str = "a") -> str:
    return _dialect(_message(f'<field type="{kind}" name="{name}">A.</field>'))


ENTRY = '<entry value="{}" name="{}"/>'
FIELDS = "".join(f'<field type="uint8_t" name="f{i}">A.</field>' for i in range(65))
WRONG = {
    "id taken": (_dialect(_message(FIELD, number=0)), "Duplicate message id 0 for HEARTBEAT"),
    "id too large": (_dialect(_message(FIELD, number=2**24)), "no number up to 16777215"),
    "id no number": (_dialect(_message(FIELD)).replace("57699", "many"), "PROBE has the id 'many'"),
    "name taken": (_dialect(_message(FIELD, name="HEARTBEAT")), "Duplicate message name HEARTBEAT"),
    "no name": (
        _dialect(_message(FIELD)).replace('name="PROBE"', ""),
        "the message with id 57699 has no name",
    ),
    "no field": (_dialect(_message("")), "PROBE has 0 fields"),
    "too many fields": (_dialect(_message(FIELDS)), "PROBE has 65 fields; a message has 1 to 64"),
    "field twice": (_dialect(_message(FIELD + FIELD)), "PROBE has two fields a"),
    "a word of Python": (_typed("float", "from"), "has the name 'from', which no program can use"),
    "its own object": (_typed("float", "self"), "has the name 'self', which no program can use"),
    "unknown type": (_typed("complex"), "PROBE.a has the type 'complex'; there are float"),
    "array too long": (_typed("uint8_t[256]"), "PROBE.a has 256 elements; an array has 1 to 255"),
    "payload too long": (_typed("double[32]"), "PROBE has 256 bytes, the wire carries 255"),
    "unknown unit of a field": (
        _dialect(_message(FIELD.replace("type", 'units="px" type'))),
        "a has the unit 'px', which MAVLink does not know; is it pix?",
    ),
    "unknown unit of a parameter": (
        _enum(
            '<entry value="57699" name="MAV_CMD_PROBE">'
            '<param index="2" label="Push" units="newton">P.</param></entry>',
            "MAV_CMD",
        ),
        "the parameter Push has the unit 'newton', which MAVLink does not know",
    ),
    "missing enum": (
        _dialect(_message(FIELD.replace("type", 'enum="NOWHERE" type'))),
        "Enum NOWHERE in PROBE.a",
    ),
    "enum twice": (
        _dialect(_message(FIELD), enums=2 * f'<enum name="X">{ENTRY.format(1, "X_A")}</enum>'),
        "Duplicate enum names",
    ),
    "value twice": (_enum(ENTRY.format(1, "A") + ENTRY.format(1, "B")), "Duplicate enum values"),
    "value is a program": (_enum(ENTRY.format("exit(3)", "A")), "the value 'exit(3)', which is no number"),
    "no power of two": (_enum(ENTRY.format(3, "A"), bitmask="true"), "no power of two"),
    "command too large": (
        _enum(ENTRY.format(65536, "MAV_CMD_PROBE"), "MAV_CMD"),
        "the wire carries up to 65535",
    ),
    "three quotes": (_dialect(_message(FIELD)).replace("A probe", 'A """ probe'), "breaks what is generated"),
    "quote at the end": (
        _dialect(_message(FIELD)).replace("A probe.", 'A "probe"'),
        "breaks what is generated",
    ),
    "missing include": (_dialect(_message(FIELD), include="nowhere.xml"), "it includes nowhere.xml"),
    "includes itself for ever": (_dialect("", include="nowhere/../../probe.xml"), "it includes probe.xml"),
    "not XML": ("<mavlink><messages>", "it is no XML (no element found: line 1, column 19)"),
    "nothing": ("", "it is no XML"),
    "another XML": ("<html/>", "its root is <html>"),
}


@pytest.mark.parametrize("way", ["table", "generator"])
@pytest.mark.parametrize("case", WRONG)
def test_an_xml_that_is_wrong_is_refused_in_one_sentence(
    case: str, way: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    xml = tmp_path / "probe.xml"
    text, what = WRONG[case]
    xml.write_text(text)
    compiled = {
        "table": compiler.build,
        "generator": lambda xml: compiler.generate(tmp_path / "out.py", xml=xml),
    }
    with pytest.raises(DialectError, match="does not compile; correct the XML") as refused:
        compiled[way](xml)
    assert refused.value.path == str(xml)
    assert what in str(refused.value)
    assert "\n" not in str(refused.value)
    assert "robotree-dialect-" not in str(refused.value), "our temporary folder means nothing to anybody"
    assert capfd.readouterr() == ("", "")
    assert not (tmp_path / "out.py").exists()


@pytest.mark.parametrize("base", ["development", "all", "ardupilotmega"])
def test_a_base_that_has_some_of_upstream_itself_goes_with_ours(base: str) -> None:
    with compiler.beside(base) as both:
        names = {each.name: each for each in compiler.build(both)}
    for name in ("AVAILABLE_MODES", "CURRENT_MODE", "COMPONENT_METADATA", "ROBOTREE_GOAL"):
        assert names[name].crc_extra == by_name()[name].crc_extra


def test_what_an_included_file_has_wrong_is_told_of_that_file(tmp_path: Path) -> None:
    (tmp_path / "inner.xml").write_text(WRONG["field twice"][0])
    (tmp_path / "outer.xml").write_text(_dialect(_message(FIELD, number=57698), include="inner.xml"))
    with pytest.raises(DialectError, match="PROBE has two fields a") as refused:
        compiler.build(tmp_path / "outer.xml")
    assert refused.value.path == str(tmp_path / "inner.xml")


EXTENDED = FIELD + '<extensions/><field type="float" name="force">A.</field>'


@pytest.mark.parametrize(
    "other",
    [
        FIELD + "<field type='float' name='force'>A.</field>",
        EXTENDED.replace("force", "width"),
        EXTENDED.replace("float", "uint32_t"),
    ],
    ids=["another field", "another extension", "an extension of another type"],
)
def test_a_message_that_is_known_as_another_one_is_refused_and_never_read_as_that(
    tmp_path: Path, other: str
) -> None:
    one, two = tmp_path / "one.xml", tmp_path / "two.xml"
    one.write_text(_dialect(_message(EXTENDED)))
    two.write_text(_dialect(_message(other)))
    with forgetting_messages():
        assert extend(one) == ["PROBE"]
        with pytest.raises(DialectError, match="PROBE with id 57699 is not the PROBE with id 57699 that"):
            extend(two)
        assert by_name()["PROBE"].fields[1].name == "force"


@pytest.mark.parametrize(("first", "second"), [(FIELD, EXTENDED), (EXTENDED, FIELD)])
def test_a_message_with_more_extensions_or_fewer_is_another_version_of_it(
    tmp_path: Path, first: str, second: str
) -> None:
    """As in another release of common.xml that lies beside somebody's dialect: MAVLink extends that way."""
    one, two = tmp_path / "one.xml", tmp_path / "two.xml"
    one.write_text(_dialect(_message(first)))
    two.write_text(_dialect(_message(second)))
    with forgetting_messages():
        assert (extend(one), extend(two)) == (["PROBE"], [])


def test_what_is_right_compiles(tmp_path: Path) -> None:
    xml, module = tmp_path / "probe.xml", tmp_path / "out.py"
    xml.write_text(_enum(ENTRY.format("2**4", "A") + ENTRY.format("0x20", "B"), bitmask="true"))
    assert {each.name for each in compiler.build(xml)} >= {"PROBE", "HEARTBEAT"}
    compiler.generate(module, xml=xml)
    compile(module.read_text(), str(module), "exec")


def test_the_dialect_compiles_for_wireshark(tmp_path: Path) -> None:
    compiler.generate(tmp_path / "robotree.lua", language="WLua")
    assert "ROBOTREE_GOAL" in (tmp_path / "robotree.lua").read_text()
    assert "WLua" in compiler.languages()


def test_regenerating_writes_the_committed_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copies = {"TABLE": tmp_path / "table.json", "CLASSES": tmp_path / "__init__.py"}
    for name, copy in copies.items():
        monkeypatch.setattr(f"robotree.protocol.dialect.__main__.{name}", copy)
    assert main() == 0
    assert copies["TABLE"].read_bytes() == TABLE.read_bytes()
    assert copies["CLASSES"].read_bytes() == CLASSES.read_bytes()
    assert capsys.readouterr().out.startswith(f"table.json: {len(definitions())} messages\n")


@pytest.mark.parametrize(
    ("name", "crc_extra"), [("COMMAND_CANCEL", 14), ("PROTOCOL_VERSION", 217), ("CONTROL_STATUS", 21)]
)
def test_what_we_take_from_upstream_is_understood_there(name: str, crc_extra: int) -> None:
    assert by_name()[name].crc_extra == crc_extra


def test_our_own_file_stands_alone() -> None:
    alone = {each.name for each in compiler.build(compiler.DIALECT.with_name("robotree.xml"))}
    assert {each for each in by_name() if each.startswith("ROBOTREE_")} <= alone
    assert "COMMAND_CANCEL" not in alone
