"""The realm's own key: made without a question, once, for its owner alone."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from robotree.protocol.errors import KeyFileError
from robotree.protocol.links.keyring import Keyring
from robotree.tui.errors import BadLine
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.grammar import Line, parse
from robotree.tui.line.manual import EVERYWHERE
from robotree.tui.wire import security
from robotree.tui.wire.security import NOTHING, REALM, key_file, realm_key, securing, wanted
from robotree.vr.base.errors import RealmUnusable


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
