"""Rules of the command line: options in any order, what it refuses, and what it leaves behind."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.errors import sentence
from robotree.tui.line.shell import PACE, Console
from tests.command_line import ROBOTREE

if TYPE_CHECKING:
    pass


@pytest.fixture
def nowhere(place: Path) -> Path:
    """A runtime folder in which no realm was ever made."""
    return place


@pytest.mark.parametrize(
    "words", [["--realm", "nosuch", "ls"], ["--realm=nosuch", "ls"], ["ls", "--realm", "nosuch"]]
)
def test_an_option_for_every_verb_stands_before_the_verb_or_behind_it(
    words: list[str], nowhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == exit_codes.NOBODY
    assert "nobody is in realm 'nosuch'" in capsys.readouterr().err
    assert list(nowhere.iterdir()) == [], "a look at a realm that is not there does not make it"


def test_what_is_for_programs_is_not_offered_to_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["host", "host-1", "--colour"]) == exit_codes.USAGE
    said = capsys.readouterr().err
    assert "known: --json, --realm" in said
    assert "tether" not in said


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (FileNotFoundError(2, "No such file or directory", "a.py"), "a.py: no such file or directory"),
        (PermissionError(13, "Permission denied"), "permission denied"),
        (ValueError("as it is"), "as it is"),
    ],
)
def test_an_error_of_the_system_is_a_sentence_without_a_number(error: Exception, says: str) -> None:
    assert sentence(error) == says


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("h2 --standby-for h2", "h2 cannot stand by for itself"),
        ("h2 --standby-for h1 --after 1s", "1 s is too short to know that a host is away"),
        ("h2 --journal mysql://db/robots", "'mysql://db/robots' is no database"),
        ("h2 --forget --journal postgresql://db/robots", "leave --journal out"),
        ("h2 --forget --standby-for h1", "--standby-for"),
    ],
)
def test_what_a_host_cannot_be_told_is_one_sentence(
    nowhere: Path, capsys: pytest.CaptureFixture[str], words: str, says: str
) -> None:
    assert main(["host", *words.split()]) == exit_codes.USAGE
    assert says in capsys.readouterr().err
    assert not any(nowhere.rglob("*.owner"))


def test_a_session_is_read_from_standard_input(
    nowhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert nowhere.exists()
    monkeypatch.setattr(sys, "stdin", io.StringIO("sleep 1ms\nfly\n"))
    assert main(["run", "-"]) == exit_codes.USAGE
    assert "-, line 2: no verb 'fly'" in capsys.readouterr().err


def test_each_step_of_a_command_is_told_in_a_log_and_the_last_always(
    capsys: pytest.CaptureFixture[str],
) -> None:
    people, programs = (Console(as_json=as_json, clock=lambda: 100.0) for as_json in (False, True))
    for step in range(1, 7):
        people.progress(step / 6, f"{step} of 6")
    assert capsys.readouterr().err.splitlines() == [f"… {step / 6:.0%} {step} of 6" for step in range(1, 7)]
    for step in range(1, 7):
        programs.progress(step / 6, "")
    assert len(capsys.readouterr().err.splitlines()) == 6
    programs.progress(float("nan"), "closing")
    assert capsys.readouterr().err == '{"progress": null, "text": "closing"}\n'


def test_a_motion_that_tells_its_share_often_fills_no_log(capsys: pytest.CaptureFixture[str]) -> None:
    now = 100.0
    console = Console(as_json=False, clock=lambda: now)
    for hundredth in range(100):
        now += PACE / 100
        console.progress(hundredth / 100, "closing")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    console.settle()
    assert capsys.readouterr().err.splitlines() == ["… 99% closing"]
    console.settle()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", ["--help", "wire dissector"])
def test_a_reader_who_has_left_ends_a_verb_in_silence(words: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as out:
        command = [*ROBOTREE, *words.split()]
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (exit_codes.DONE, "")
