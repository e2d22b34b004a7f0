"""A user's dialect beside ours: compiled, its mistakes reported, and decoded."""

from __future__ import annotations

import io
import json
import os
import socket
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest
from fastcrc.crc16 import mcrf4xx
from mcap.reader import make_reader

from robotree.protocol import encode
from robotree.protocol.dialect.compile import build
from robotree.protocol.frame import CRC_START
from robotree.protocol.messages import NamedValueFloat
from robotree.tui import exit_codes
from tests.command_line import ROBOTREE

PROBE = '<message id="{}" name="{}"><description>A probe.</description>{}</message>'
FIELDS = (
    '<field type="uint16_t" name="depth" units="m">Depth.</field>'
    '<field type="char[4]" name="tag">Tag.</field>'
)
ALONE = "<dialect>0</dialect>"
OURS, COMMON = f"<include>robotree.xml</include>{ALONE}", f"<include>common.xml</include>{ALONE}"


def dialect(folder: Path, messages: str, head: str = OURS) -> Path:
    path = folder / "mine.xml"
    path.write_text(f"<mavlink>{head}<messages>{messages}</messages></mavlink>")
    return path


def elsewhere(*words: str | Path, **options: object) -> subprocess.CompletedProcess[bytes]:
    """Say it in a process of its own, where what a dialect adds stays."""
    return subprocess.run([*ROBOTREE, *map(str, words)], capture_output=True, check=False, **options)  # type: ignore[call-overload,no-any-return]  # passed on


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    return dialect(tmp_path, PROBE.format(57901, "PROBE", FIELDS))


@pytest.fixture
def stream(mine: Path) -> bytes:
    """A frame of our own, and one of the dialect, made by hand from what it compiles to."""
    (probe,) = [each for each in build(mine) if each.name == "PROBE"]
    body = struct.pack("<BBBBBBB3sH4s", 0xFD, 6, 0, 0, 1, 1, 1, (57901).to_bytes(3, "little"), 1500, b"deep")
    checksum = mcrf4xx(body + bytes((probe.crc_extra,)), CRC_START)
    ours = encode(NamedValueFloat(1, "x", 0.5), sequence=0, system=1, component=1)
    return ours + body + checksum.to_bytes(2, "little")


def test_messages_of_ones_own_dialect_are_decoded_beside_ours(
    say: Any, tmp_path: Path, mine: Path, stream: bytes
) -> None:
    (tmp_path / "both.raw").write_bytes(stream)
    plain = say("wire", "decode", tmp_path / "both.raw", "--json")
    said = elsewhere("wire", "decode", "-", "--json", "--xml", mine, input=stream)
    *frames, last = map(json.loads, said.stdout.splitlines())
    assert [(frame["name"], frame["fields"]) for frame in frames][1:] == [
        ("PROBE", {"depth": 1500, "tag": "deep"})
    ]
    assert (last["statistics"]["frames"], last["statistics"]["unknown"]) == (2, 0)
    assert plain.objects[-1]["statistics"]["unknown"] == 1


def test_a_recording_of_unknown_messages_alone_is_answered_with_their_ids(
    say: Any, tmp_path: Path, stream: bytes
) -> None:
    (tmp_path / "a.raw").write_bytes(stream[stream.index(b"\xfd", 1) :] * 3)
    said = say("wire", "decode", tmp_path / "a.raw")
    assert said.code == exit_codes.REFUSED
    assert said.err == (
        f"robotree: {tmp_path}/a.raw: there is no frame in it that we know; "
        "what it has is of unknown ids (57901); name the dialect that has them with --xml\n"
    )
    assert "unknown id 3 (57901), " in said.out


def test_messages_of_ones_own_dialect_are_recorded_as_topics(
    tmp_path: Path, mine: Path, stream: bytes
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as robot:
        url, file = f"tcp:127.0.0.1:{robot.getsockname()[1]}", tmp_path / "mine.mcap"
        words = ["wire", "record", "--connect", url, str(file), "--xml", str(mine)]
        with subprocess.Popen(
            [*ROBOTREE, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as recording:
            link, _ = robot.accept()
            with link:
                link.sendall(stream)
                link.shutdown(socket.SHUT_WR)  # closed now, it would take back what was not read
                while link.recv(4096):
                    pass
            recording.communicate(timeout=60)
    heard = {
        channel.topic: message.data
        for _, channel, message in make_reader(io.BytesIO(file.read_bytes())).iter_messages()
    }
    assert json.loads(heard["/1/1/PROBE"]) == {"depth": 1500, "tag": "deep"}
    assert heard.keys() == {"/mavlink", "/1/1/PROBE", "/1/1/NAMED_VALUE_FLOAT"}


@pytest.mark.parametrize("head", [OURS, COMMON, ALONE])
def test_ones_own_dialect_is_generated_whatever_it_includes(say: Any, tmp_path: Path, head: str) -> None:
    mine = dialect(tmp_path, PROBE.format(57901, "PROBE", FIELDS), head)
    said = say("wire", "dialect", "--lang", "c", tmp_path / "c", "--xml", mine, "--json")
    written = {Path(name).name for name in said.objects[0]["files"]}
    assert "mavlink_msg_probe.h" in written
    assert ("mavlink_msg_robotree_gripper.h" in written) == ("robotree" in head)


def test_wireshark_is_told_of_ones_own_messages_whatever_lies_beside_them(
    say: Any, tmp_path: Path, mine: Path
) -> None:
    os.mkfifo(tmp_path / "fifo.xml")
    (tmp_path / "zero.xml").symlink_to("/dev/zero")
    (tmp_path / "gone.xml").symlink_to("nowhere")
    assert say("wire", "dissector", tmp_path / "mine.lua", "--xml", mine).code == exit_codes.DONE
    lua = (tmp_path / "mine.lua").read_text()
    assert "ROBOTREE_JOINTS" in lua
    assert "PROBE" in lua
    assert say("wire", "dissector", tmp_path / "mine.lua").code == exit_codes.REFUSED, "it is there already"
    for name, reason in (
        ("fifo.xml", "it cannot be read: it is a FIFO"),
        ("zero.xml", "it cannot be read: it is a device"),
        ("none.xml", "there is no such file"),
    ):
        said = say("wire", "dissector", "--xml", tmp_path / name)
        assert said.code == exit_codes.REFUSED
        assert f"{name} does not compile; correct the XML: {reason}" in said.err


WRONG = {
    "a field's type": (
        PROBE.format(57901, "PROBE", FIELDS.replace("uint16_t", "word")),
        "has the type 'word'",
    ),
    "an id of ours": (PROBE.format(57600, "PROBE", FIELDS), "Duplicate message id 57600"),
    "no XML": ("<", "it is no XML"),
}


@pytest.mark.parametrize("verb", [("dialect", "--lang", "c", "out"), ("dissector",), ("decode", "-")])
@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_with_it_is_said_in_one_sentence(
    say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: tuple[str, ...], wrong: str
) -> None:
    monkeypatch.chdir(tmp_path)
    messages, told = WRONG[wrong]
    said = say("wire", *verb, "--xml", dialect(tmp_path, messages))
    (sentence,) = said.err.splitlines()
    assert told in sentence
    assert "mine.xml does not compile; correct the XML: " in sentence
    assert said.code == exit_codes.REFUSED
    assert not (tmp_path / "out").exists()


def test_a_message_that_is_ours_and_another_one_at_once_is_refused(say: Any, tmp_path: Path) -> None:
    """It stands alone, so its own file is right."""
    mine = dialect(tmp_path, PROBE.format(0, "PROBE", FIELDS), ALONE)
    said = say("wire", "decode", "-", "--xml", mine)
    assert "PROBE with id 0 is not the HEARTBEAT with id 0 that robotree knows" in said.err
    assert said.code == exit_codes.REFUSED


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a link away")
def test_a_dialect_is_not_written_through_a_link_of_somebody_else(say: Any, tmp_path: Path) -> None:
    (tmp_path / "precious").symlink_to(tmp_path / "nowhere")
    os.lchown(tmp_path / "precious", 65534, 65534)
    said = say("wire", "dialect", "--lang", "python", tmp_path / "precious")
    assert said.code == exit_codes.REFUSED
    assert "it is a link that user 65534 made" in said.err
    assert not (tmp_path / "nowhere").exists()
