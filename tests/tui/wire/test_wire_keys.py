"""Keys on the command line: what is meant to be signed is signed, or does not start."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from robotree.protocol.links.keyring import create
from robotree.tui import exit_codes

LISTENING = ("sim", "arm", "--listen", "tcp:127.0.0.1:0")
DIALLING = ("proxy", "arm", "arm-1", "--connect", "tcp:127.0.0.1:1", "--space", "none")
WATCHING = ("wire", "monitor", "--connect", "udp:127.0.0.1:9", "tcp:127.0.0.1:1")


@pytest.fixture(autouse=True)
def apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("ROBOTREE_KEY", raising=False)


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


def test_the_demo_does_not_start_unsigned(say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTREE_KEY", str(key_for("can:robotree/demo-keys?node=1*", tmp_path)))
    said = say("demo", "--headless", "--can", "--realm", "keys", "--pictures", tmp_path / "pictures")
    assert (said.code, said.out) == (exit_codes.REFUSED, "")
    assert "no pattern matches the links of can:robotree/demo-keys?fd=1&node=2" in said.err
