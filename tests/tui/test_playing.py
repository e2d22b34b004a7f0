"""Sessions played on a real realm client."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.tui.errors import SessionError
from robotree.tui.session.playing import placed, read_file
from tests.tui.conftest import EXAMPLES, play

if TYPE_CHECKING:
    from conftest import Realm

BESIDE = str(EXAMPLES / "a.session")


async def test_a_session_builds_a_tree_commands_it_and_expects_what_comes_of_it(realm: Realm) -> None:
    report, told = await play(
        realm,
        """
        expect arm-1 listed
        create move_to.py as mover            # found beside the script
        expect mover.arm empty
        enslave mover.arm arm-1
        expect arm-1 enslaved by mover.arm within 1s
        expect mover.arm holds arm-1
        call mover.move x=0.45 y=0 z=0.3 twist=0
        expect mover idle
        call mover.get_info
        expect result.x = 0.45
        expect reading arm-1.x = 0.45
        expect reading cell.lever < 0
        try call arm-1.hold
        expect refused NotInControl
        delete mover
        expect mover gone
        expect arm-1 listed within 2s
        call arm-1.hold
        expect done
        """,
    )
    assert report.ok, told[-1].seen
    assert len(told) == 19
    assert report.structure()["ok"] is True
    assert [one.began for one in told] == sorted(one.began for one in told)


async def test_a_session_pauses_a_command_and_lets_steps_pass(realm: Realm) -> None:
    report, told = await play(
        realm,
        """
        create move_to.py as mover
        enslave mover.arm arm-1
        pause mover
        call --detach mover.move x=0.45 y=0 z=0.3 twist=0
        expect mover paused within 1s
        step mover
        step mover
        expect mover paused
        continue mover
        sleep 200ms
        expect mover idle within 20s
        expect reading arm-1.x = 0.45
        """,
    )
    assert report.ok, told[-1].seen


async def test_a_session_ends_at_the_first_step_that_does_not_hold_and_says_what_was_seen(
    realm: Realm,
) -> None:
    report, told = await play(realm, "expect reading cell.lever > 0.75 within 200ms\nstop\nresume\n")
    assert not report.ok
    assert told[-1].seen == "not within 0.2 s: -0.785"
    assert report.left == ("stop", "resume")
    _, told = await play(realm, "call arm-1.get_info\nexpect result.x = 77 within 60s\n")
    assert "within" not in told[-1].seen, "what is over is judged at once"


async def test_a_refused_verb_ends_a_session_unless_it_was_tried(realm: Realm) -> None:
    report, told = await play(realm, "call arm-1.stumble\n")
    assert not report.ok
    assert told[-1].seen == "CommandFailed: arm-1.stumble failed: a stone [/x] lay there"
    report, _ = await play(realm, "try call arm-1.stumble\nexpect refused CommandFailed\n")
    assert report.ok


async def test_an_expectation_waits_until_it_comes_true(realm: Realm) -> None:
    realm.arm.pace = 0.03
    report, told = await play(realm, "expect reading arm-1.z < 0.35 within 100ms\n")
    assert not report.ok
    report, told = await play(
        realm, "call arm-1.go_to x=0.3 y=0 z=0.3 twist=0\nexpect reading arm-1.z = 0.3\n"
    )
    assert report.ok, told[-1].seen


async def test_readings_of_nobody_are_nothing(realm: Realm) -> None:
    _, told = await play(realm, "expect reading nobody.x > 0 within 10ms\n")
    assert "nobody" in told[-1].seen


def test_a_page_beside_the_script_comes_before_one_of_that_name_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "move_to.py").write_text("not what the script means")
    (tmp_path / "mine.py").touch()
    assert placed("move_to.py", BESIDE) == EXAMPLES / "move_to.py"
    assert placed("mine.py", BESIDE) == Path("mine.py")
    assert placed("mine.py", "-") == Path("mine.py")


def test_a_script_that_cannot_be_read_says_so(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="cannot read the session"):
        read_file(str(tmp_path / "none.session"))
    (tmp_path / "bytes.session").write_bytes(b"\xff\xfe")
    os.mkfifo(tmp_path / "fifo.session")
    with pytest.raises(SessionError, match="it is a FIFO"):
        read_file(str(tmp_path / "fifo.session"))
    with pytest.raises(SessionError, match="it is a device"):
        read_file("/dev/zero")
    with pytest.raises(SessionError, match="not UTF-8"):
        read_file(str(tmp_path / "bytes.session"))


def test_the_session_of_the_demo_is_understood() -> None:
    assert read_file(str(EXAMPLES / "close_lever.session")).steps
