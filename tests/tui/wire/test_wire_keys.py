"""Keys on the command line, and the realm's own: what is meant to be signed is signed, or does not start."""

from __future__ import annotations

import fcntl
import os
import re
import subprocess
import sys
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket
from typing import Any

import pytest

from robotree.protocol import Parser
from robotree.protocol.errors import KeyFileError
from robotree.protocol.links.keyring import Keyring, create
from robotree.tui import exit_codes
from robotree.tui.errors import BadLine
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.grammar import Line, parse
from robotree.tui.line.manual import EVERYWHERE
from robotree.tui.wire import security
from robotree.tui.wire.security import NOTHING, REALM, key_file, realm_key, securing, wanted
from robotree.vr.base.errors import RealmUnusable

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


# -- the realm's own key: made without a question, once, for its owner alone -----------------------


def line(*words: str) -> Line:
    return parse(list(words), shapes(Where.SHELL), EVERYWHERE)


def fingerprint(path: Path) -> str:
    ((_, key),) = Keyring(path).keys
    return key.fingerprint


def test_it_is_made_once_and_lies_in_the_realms_folder_for_its_owner_alone(place: Path) -> None:
    path = realm_key("cell")
    assert path == place / "robotree" / "cell" / "realm.key"
    modes = [one.stat().st_mode & 0o777 for one in (path, path.parent, path.parent.parent)]
    assert modes == [0o600, 0o700, 0o700]
    before = fingerprint(path)
    assert fingerprint(realm_key("cell")) == before
    assert fingerprint(realm_key("other")) != before
    assert [one.name for one in path.parent.iterdir()] == ["realm.key"]


def test_who_was_not_waited_for_and_is_quicker_has_made_the_key_of_all(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(security, "KEY_WITHIN", 0.05)
    real, quicker = security.create, list[str]()

    def create(draft: Path) -> None:
        monkeypatch.setattr(security, "create", real)
        quicker.append(fingerprint(realm_key("cell")))
        real(draft)

    monkeypatch.setattr(security, "create", create)
    assert place.exists()
    assert [fingerprint(realm_key("cell"))] == quicker


KEY_OF_TWO = """
import fcntl, sys
from pathlib import Path
from robotree.vr.network import realms
from robotree.tui.wire import security
realms.LOGIN, realms.SHARED = Path(sys.argv[1]), Path(sys.argv[2])

def note(module, name, word, *, pause):
    real = getattr(module, name)
    def noted(*arguments):
        print(word, flush=True)
        if pause:
            sys.stdin.readline()
        return real(*arguments)
    setattr(module, name, noted)

note(fcntl, "flock", "waits", pause=False)
note(security, "create", "makes", pause=True)
print(security.Keyring(security.realm_key("cell")).keys[0][1].fingerprint)
"""
"""Makes the key of a realm that may lie in two folders: says when it waits, pauses before it makes one."""


def test_a_service_and_a_session_that_come_at_the_same_moment_make_one_key(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    login, shared = place / "user", place / "shared"
    session = login / str(os.geteuid())
    for folder in (session, shared):
        folder.mkdir(mode=0o700, parents=True)

    def come() -> subprocess.Popen[str]:
        line = [sys.executable, "-c", KEY_OF_TWO, str(login), str(shared)]
        return subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(session))
    first = come()
    assert first.stdout is not None
    while first.stdout.readline() != "makes\n":
        assert first.poll() is None
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    second = come()
    assert second.stdout is not None
    assert second.stdout.readline() in {"waits\n", "makes\n"}
    fingerprints = [each.communicate("\n")[0].split()[-1] for each in (first, second)]
    assert fingerprints[0] == fingerprints[1]


def test_who_is_stopped_while_it_makes_a_key_keeps_nobody_out(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(security, "KEY_WITHIN", 0.05)
    folder = place / "robotree" / "cell"
    folder.mkdir(parents=True, mode=0o700)
    stopped = os.open(folder, os.O_RDONLY)
    fcntl.flock(stopped, fcntl.LOCK_EX)
    assert fingerprint(realm_key("cell")) == fingerprint(realm_key("cell"))
    os.close(stopped)


def test_a_file_system_without_hard_links_is_no_obstacle(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    assert fingerprint(realm_key("cell")) == fingerprint(realm_key("cell"))
    assert [one.name for one in (place / "robotree" / "cell").iterdir()] == ["realm.key"]


@pytest.mark.timeout(60)
def test_what_lies_in_its_place_is_not_taken_for_it(place: Path) -> None:
    folder = place / "robotree" / "cell"
    folder.mkdir(parents=True, mode=0o700)
    prepared = (
        (os.mkfifo, "it is a FIFO"),
        (Path.mkdir, "it is a folder"),
        (Path.touch, "others can read it"),
    )
    for prepare, reason in prepared:
        prepare(folder / "realm.key")
        with pytest.raises(KeyFileError, match=reason):
            Keyring(realm_key("cell"))
        (folder / "realm.key").rmdir() if (folder / "realm.key").is_dir() else (folder / "realm.key").unlink()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_nobody_else_prepares_the_folder(place: Path) -> None:
    (place / "robotree").mkdir()
    os.chown(place / "robotree", 65534, 65534)
    with pytest.raises(RealmUnusable, match="belongs to somebody else"):
        realm_key("cell")


def test_a_line_chooses_before_the_environment_and_that_before_what_is_meant(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sim = ("sim", "arm", "--listen", "tcp:0")
    assert wanted(line(*sim)) == NOTHING
    assert wanted(line("demo"), REALM) == REALM
    monkeypatch.setenv("ROBOTREE_KEY", "ours.key")
    assert wanted(line("demo"), REALM) == "ours.key"
    assert wanted(line(*sim, "--key", "other.key")) == "other.key"
    assert wanted(line(*sim, "--open")) == wanted(line(*sim, "--key", "none")) == NOTHING
    assert key_file(REALM, "cell") == place / "robotree" / "cell" / "realm.key"
    assert key_file("a.key", "cell") == Path("a.key")
    assert key_file(NOTHING, "cell") is None
    with pytest.raises(BadLine):
        line(*sim, "--open", "--key", "ours.key")


async def test_links_are_signed_exactly_where_there_is_a_key(place: Path) -> None:
    for words, signed in ((("--open",), False), (("--key", "realm"), True), ((), False)):
        async with securing(line("sim", "arm", "--listen", "tcp:0", "--realm", "cell", *words)) as security:
            assert security.signed == signed
            assert (security.signer_pair("tcp:127.0.0.1:1")["signer"] is not None) == signed
    assert (place / "robotree" / "cell" / "realm.key.time").exists()
