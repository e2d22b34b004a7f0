"""The dialect in other languages is used with those languages' own tools, where they are installed."""

from __future__ import annotations

import importlib.util
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.dialect import languages
from robotree.protocol.dialect.errors import NoFile, TargetTaken, UnknownBase, UnknownLanguage
from robotree.protocol.dialect.languages import dissector
from robotree.protocol.errors import DialectError
from robotree.protocol.frame import Frame
from robotree.protocol.messages import Gripper, NamedValueFloat
from robotree.protocol.tools.capture import Decoder
from tests.command_line import ran

GCC, JAVAC, TSHARK = (shutil.which(name) or "" for name in ("gcc", "javac", "tshark"))

QUICK = ("-implicit:none", "-proc:none", "-J-XX:TieredStopAtLevel=1", "-J-XX:+UseSerialGC")
"""Generate code for our messages only, by a virtual machine that is made to end soon."""

DECODER_IN_C = """
#include <stdio.h>
#include <mavlink.h>
int main(void) {
    mavlink_message_t m; mavlink_status_t s;
    for (int c; (c = getchar()) != EOF;)
        if (mavlink_parse_char(MAVLINK_COMM_0, (uint8_t)c, &m, &s)) {
            printf("%u %u %u %u", m.msgid, m.sysid, m.compid, m.seq);
            if (m.msgid == MAVLINK_MSG_ID_ROBOTREE_GRIPPER)
                printf(" %.9g", mavlink_msg_robotree_gripper_get_width(&m));
            putchar('\\n');
        }
    return 0;
}
"""
USER0 = 147
"""The link type of a capture file that Wireshark gives to the dissector."""


@pytest.mark.skipif(not GCC, reason="no C compiler is installed")
def test_a_program_in_c_understands_the_arm(tmp_path: Path, frames: list[Frame]) -> None:
    languages.write("c", tmp_path / "include")
    source, program = tmp_path / "decode.c", tmp_path / "decode"
    source.write_text(DECODER_IN_C)
    include = tmp_path / "include" / compiler.DIALECT.stem
    flags = ["-std=c99", "-Wall", "-Werror", "-Wno-address-of-packed-member", "-isystem", str(include)]
    subprocess.run([GCC, *flags, str(source), "-o", str(program)], check=True)
    heard = subprocess.run(
        [program], input=b"".join(frame.raw for frame in frames), capture_output=True, check=True
    )
    expected = [
        f"{frame.msgid} {frame.system} {frame.component} {frame.sequence}"
        + (f" {frame.message.width:.9g}" if isinstance(frame.message, Gripper) else "")
        for frame in frames
    ]
    assert heard.stdout.decode().splitlines() == expected


@pytest.mark.skipif(not JAVAC, reason="no Java compiler is installed")
def test_the_java_of_our_messages_compiles(tmp_path: Path) -> None:
    written = languages.write("java", tmp_path / "com" / "MAVLink")
    ours = [path for path in written if path.name.startswith("msg_robotree")]
    assert ours
    done = ran([JAVAC, *QUICK, "-nowarn", "-sourcepath", tmp_path, "-d", tmp_path / "classes", *ours])
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", sorted({*languages.LANGUAGES} - {"c", "java"}))
def test_every_language_that_is_offered_is_written(name: str, tmp_path: Path) -> None:
    written = languages.write(name, tmp_path / "out")
    text = "".join(path.read_text(errors="replace") for path in written)
    assert "robotree_gripper" in text.lower().replace("robotreegripper", "robotree_gripper")


def test_as_xml_it_is_complete(tmp_path: Path) -> None:
    languages.write("xml", tmp_path / "xml")
    for path in (tmp_path / "xml").iterdir():
        for line in path.read_text().splitlines():
            if "<include>" in line:
                included = line.partition("<include>")[2].partition("</include>")[0]
                assert (tmp_path / "xml" / included).is_file()


def read(path: Path) -> Any:
    """A generated module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_base_dialect_is_written_with_ours_for_a_tool_that_wants_both(tmp_path: Path) -> None:
    (path,) = languages.write("python", tmp_path / "both_of_them.py", base="ardupilotmega")
    module = read(path)
    assert (module.MAVLINK_MSG_ID_RADIO, module.MAVLINK_MSG_ID_ROBOTREE_GOAL) == (166, 57603)


def test_a_base_dialect_that_is_not_there_is_answered_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(UnknownBase, match=r"called 'ardu'; there is .*ardupilotmega, "):
        languages.write("python", tmp_path / "out.py", base="ardu")


def test_a_dialect_that_does_not_go_with_a_base_is_named_by_its_own_name(tmp_path: Path) -> None:
    mine = tmp_path / "mine.xml"
    probe = '<message id="166" name="PROBE"><description/><field type="uint8_t" name="a"/></message>'
    mine.write_text(f"<mavlink><messages>{probe}</messages></mavlink>")
    with pytest.raises(DialectError, match=r"mine\.xml .*: it does not go with ardupilotmega: .* id 166"):
        languages.write("python", tmp_path / "out.py", mine, base="ardupilotmega")


def test_an_xml_that_only_includes_others_is_written(tmp_path: Path) -> None:
    mine = tmp_path / "mine.xml"
    mine.write_text("<mavlink><include>robotree.xml</include></mavlink>")
    (path,) = languages.write("python", tmp_path / "out.py", mine)
    assert "MAVLINK_MSG_ID_ROBOTREE_GOAL" in path.read_text()


def test_a_folder_for_a_language_of_one_file_is_answered_with_the_name_of_a_file(tmp_path: Path) -> None:
    with pytest.raises(NoFile, match=r"name a file such as .*/robotree\.py"):
        languages.write("python", tmp_path)


def test_nothing_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "mine.h").write_text("precious")
    with pytest.raises(TargetTaken):
        languages.write("c", tmp_path)
    with pytest.raises(TargetTaken):
        languages.write("python", tmp_path / "mine.h")


def test_a_language_that_does_not_work_is_not_offered(tmp_path: Path) -> None:
    with pytest.raises(UnknownLanguage, match="there is c, c"):
        languages.write("ada", tmp_path / "out")


def test_an_xml_that_does_not_compile_leaves_nothing_behind(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.xml"
    wrong.write_text("<mavlink><messages><message id='1' name='A'></messages></mavlink>")
    with pytest.raises(DialectError):
        languages.write("c", tmp_path / "out", wrong)
    assert not (tmp_path / "out").exists()


def test_the_dissector_is_bound_to_the_ports_that_are_asked_for() -> None:
    text = dissector([5999])
    assert 'DissectorTable.get("tcp.port"):add(5999, mavlink_proto)' in text
    assert "ROBOTREE_JOINTS" in text


def pcap(frames: list[Frame]) -> bytes:
    """A capture file with one packet per frame."""
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 0x40000, USER0)
    packets = [
        struct.pack("<IIII", 1_700_000_000, n, len(one.raw), len(one.raw)) + one.raw
        for n, one in enumerate(frames)
    ]
    return head + b"".join(packets)


@pytest.mark.skipif(not TSHARK, reason="tshark is not installed")
def test_tshark_understands_the_arm(tmp_path: Path, frames: list[Frame]) -> None:
    (tmp_path / "robotree.lua").write_text(dissector())
    (tmp_path / "arm.pcap").write_bytes(pcap(frames))
    words = [
        TSHARK,
        "-r",
        tmp_path / "arm.pcap",
        "-X",
        f"lua_script:{tmp_path / 'robotree.lua'}",
        "-T",
        "fields",
    ]
    fields = ["mavlink_proto.msgid", "mavlink_proto.sysid", "mavlink_proto.sequence"]
    done = ran([*words, *(word for field in fields for word in ("-e", field))], check=True)
    expected = [f"{frame.msgid}\t{frame.system}\t{frame.sequence}" for frame in frames]
    assert done.stdout.splitlines() == expected


def test_what_python_reads_in_the_generated_module_is_what_we_wrote(tmp_path: Path) -> None:
    (path,) = languages.write("python", tmp_path / "robotree_generated.py")
    module = read(path)
    raw = encode(NamedValueFloat(time_boot_ms=5, name="lever", value=0.5), sequence=3, system=1, component=1)
    (message,) = module.MAVLink(None).parse_buffer(raw)
    assert (message.name, message.value, message.get_seq()) == ("lever", 0.5, 3)
    assert Parser().feed(raw)[0].name == message.get_type()
    assert Decoder("raw").feed(raw)[0].plain()["fields"]["name"] == "lever"
