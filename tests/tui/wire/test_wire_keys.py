"""Keys on the command line: what is meant to be signed is signed, or does not start."""

from __future__ import annotations

import os
import re
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket
from typing import Any

import pytest

from robotree.protocol import Parser
from robotree.protocol.links.keyring import create
from robotree.tui import exit_codes

pytestmark = pytest.mark.usefixtures("place")
LISTENING = ("sim", "arm", "--listen", "tcp:127.0.0.1:0")
DIALLING = ("proxy", "arm", "arm-1", "--connect", "tcp:127.0.0.1:1")
WATCHING = ("wire", "monitor", "--connect", "udp:127.0.0.1:9", "tcp:127.0.0.1:1")


def key_for(pattern: str, folder: Path) -> Path:
    create(folder / "cell.key", pattern)
    return folder / "cell.key"


@pytest.mark.parametrize("words", [LISTENING, DIALLING, WATCHING], ids=lambda words: words[0])
def test_what_its_keys_do_not_fit_does_not_start(say: Any, tmp_path: Path, words: tuple[str, ...]) -> None:
    said = say(*words, "--key", key_for("udp:*", tmp_path))
    assert said.code == exit_codes.REFUSED
    assert said.out == ""
    assert "no pattern matches the links of tcp:127.0.0.1:" in said.err
    assert "there is udp:*;" in said.err
    assert said.err.count("\n") == 1


def test_a_file_without_keys_starts_nothing(say: Any, tmp_path: Path) -> None:
    empty = tmp_path / "empty.key"
    os.close(os.open(empty, os.O_CREAT, 0o600))
    said = say(*LISTENING, "--key", empty)
    assert (said.code, said.out) == (exit_codes.REFUSED, "")
    assert "holds no key; make another file with `robotree wire key FILE`" in said.err


def test_who_has_the_key_records_a_robot_that_waits_to_be_spoken_to(
    say: Any, guarded: Any, tmp_path: Path
) -> None:
    words = ("wire", "record", "--connect", guarded.address, "--for", "1500ms", "--json")
    said = say(*words, tmp_path / "right.tlog", "--key", guarded.key)
    assert said.code == exit_codes.DONE, said.err
    assert said.objects[0]["frames"] > 0


def test_a_recording_of_nothing_is_no_success(say: Any, tmp_path: Path) -> None:
    with socket(AF_INET, SOCK_DGRAM) as dumb:
        dumb.bind(("127.0.0.1", 0))
        address = f"udp:127.0.0.1:{dumb.getsockname()[1]}"
        said = say("wire", "record", "--connect", address, tmp_path / "a.tlog", "--for", "300ms")
        dumb.setblocking(False)
        heard = Parser().feed(dumb.recv(2048))
    assert said.code == exit_codes.NOBODY
    assert f"no frame that could be recorded came from {address}" in said.err
    assert list(tmp_path.iterdir()) == [], "no file is in the way of the next"
    assert [frame.name for frame in heard] == ["HEARTBEAT"]


@pytest.mark.parametrize("by", ["ping", "timesync"])
def test_a_ping_with_a_wrong_key_says_that_it_is_the_key(say: Any, guarded: Any, by: str) -> None:
    words = ("wire", "ping", "--connect", guarded.address, "--count", "3", "--every", "100ms", "--by", by)
    wrong = say(*words, "--key", guarded.wrong)
    assert wrong.code == exit_codes.NOBODY
    assert re.search(r"answers: frames arrive but none is signed with our key \(\d+ refused\)", wrong.err)
    without = say(*words)
    assert without.code == exit_codes.NOBODY
    assert "its controller signs what it says and this link has no key" in without.err
    assert "try --by" not in wrong.err + without.err


def test_a_monitor_with_a_wrong_key_shows_nothing_as_live_but_what_was_refused(
    say: Any, guarded: Any
) -> None:
    words = ("wire", "monitor", "--connect", guarded.address, "--for", "1500ms", "--every", "500ms")
    (link,) = say(*words, "--json", "--key", guarded.wrong).objects[-1]["links"]
    assert link["messages"] == []
    assert link["refused"] > 10
    table = say(*words, "--key", guarded.wrong).out
    assert "frames arrive but none is signed with our key" in table
    (link,) = say(*words, "--json", "--key", guarded.key).objects[-1]["links"]
    assert (link["refused"], link["rejection"]) == (0, "")
    assert {"HEARTBEAT", "ROBOTREE_JOINTS"} <= {row["name"] for row in link["messages"]}
    (link,) = say(*words, "--json").objects[-1]["links"]
    assert "this link has no key: they cannot be checked" in link["rejection"]
