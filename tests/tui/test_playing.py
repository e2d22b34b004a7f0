"""Sessions played on a real realm client: their steps, faults of drills, and the report that they leave."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.cli import main
from robotree.tui.errors import SessionError
from robotree.tui.exit_codes import REFUSED, USAGE
from robotree.tui.processes.thaw import freeze
from robotree.tui.screen.app import Supervisor
from robotree.tui.session import junit
from robotree.tui.session.faults import drill_of, end_all
from robotree.tui.session.playing import placed, read_file
from robotree.tui.session.script import PlayedStep, Report, Step, read
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import State
from tests.screen import text_of
from tests.tui.conftest import EXAMPLES, play
from tests.waiting import until

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


# -- a fault is said by whom it concerns, and ends with its time, with the drill, and with the trial


class Linked:
    """What is done to the link of the arm."""

    def __init__(self, realm: Realm) -> None:
        self.done: list[tuple[bool, float]] = []
        realm.arm.disturb = lambda *, cut, delay: self.done.append((cut, delay))  # type: ignore[attr-defined]


async def drilled(realm: Realm, text: str) -> list[PlayedStep]:
    with sitting_at("pts/3"):
        return (await play(realm, text))[1]


async def test_a_cut_begins_and_ends_with_the_line(realm: Realm) -> None:
    link = Linked(realm)
    told = await drilled(realm, "fault cut arm-1 --for 1min\nshow arm-1\nfault end\nshow arm-1\n")
    assert [each.held for each in told] == [True] * 4, [each.seen for each in told]
    assert "@pts/3" in told[1].seen
    assert "cut, by " in told[1].seen
    assert told[2].seen == "the drill is over: arm-1"
    assert "cut, by " not in told[3].seen
    assert link.done == [(True, 0.0), (False, 0.0)]


async def test_a_fault_ends_with_its_time(realm: Realm) -> None:
    link = Linked(realm)
    states: list[State] = []
    await realm.realm_client.watch_state("arm-1", lambda _, state: states.append(state))
    with sitting_at("pts/3"):
        await realm.realm_client.disturb("arm-1", "cut", seconds=0.05)
    await until(lambda: link.done == [(True, 0.0), (False, 0.0)], "it has ended by itself")
    await until(lambda: bool(states) and not states[-1].drill, "its state says nothing of it")


async def test_the_next_fault_takes_the_place_of_the_one_before(realm: Realm) -> None:
    link = Linked(realm)
    await drilled(realm, "fault cut arm-1\nfault delay arm-1 200ms\n")
    assert link.done == [(True, 0.0), (False, 0.0), (False, 0.2), (False, 0.0)]


async def test_a_fault_stands_on_the_screen(
    realm: Realm, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    Linked(realm)
    async with Supervisor(realm.realm_client, realm="").run_test(size=(80, 24)) as pilot:
        with sitting_at("pts/3"):
            await realm.realm_client.disturb("arm-1", "cut", seconds=60.0)
        await until(lambda: "DRILL: arm-1 cut, by " in text_of(pilot.app), "it stands on the screen")
        await realm.realm_client.disturb("arm-1", "")
        await until(lambda: "DRILL" not in text_of(pilot.app), "it is gone")


@pytest.mark.parametrize(
    ("seconds", "delay", "terminal", "reason"),
    [
        (0.0, 0.0, "pts/3", "it lasts more than 0"),
        (float("nan"), 0.0, "pts/3", "it lasts more than 0"),
        (7200.0, 0.0, "pts/3", "at most 3600 s"),
        (1.0, -1.0, "pts/3", "a delay is 0 to 60 s"),
        (1.0, float("inf"), "pts/3", "a delay is 0 to 60 s"),
        (1.0, 0.0, "mcp/claude", "may not command arm-1"),
        (1.0, 0.0, "", "only a person"),
    ],
)
async def test_what_cannot_be_a_drill_is_refused(
    realm: Realm, seconds: float, delay: float, terminal: str, reason: str
) -> None:
    link = Linked(realm)
    with sitting_at(terminal), pytest.raises(VrError, match=reason):
        await realm.realm_client.disturb("arm-1", "delay", seconds=seconds, delay=delay)
    assert link.done == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
async def test_a_frozen_process_wakes_with_the_drill_when_its_helper_is_gone(
    realm: Realm, number: signal.Signals
) -> None:
    frozen = psutil.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    try:
        pidfd = os.pidfd_open(frozen.pid)
        helper = await asyncio.to_thread(freeze, pidfd, 600.0)
        drill_of(realm.realm_client).frozen["arm-1"] = helper, pidfd
        await until(lambda: frozen.status() == psutil.STATUS_STOPPED, "it is frozen")
        helper.send_signal(number)
        await end_all(realm.realm_client)
        await until(lambda: frozen.status() != psutil.STATUS_STOPPED, "it goes on")
    finally:
        frozen.kill()
        frozen.wait()


# -- a session leaves a report that test servers read ----------------------------------------------


def _suite(report: bytes) -> ET.Element:
    suite = ET.fromstring(report).find("testsuite")  # noqa: S314 # written by the test itself
    assert suite is not None
    return suite


def _played(step: Step, *, held: bool, seen: str = "") -> PlayedStep:
    return PlayedStep(step=step, held=held, seen=seen, began=0.0, took=0.25)


def test_each_step_is_a_case_and_what_was_not_played_is_skipped() -> None:
    steps = read("ls\ncall arm-1.hold\nls\n", "a.session").steps
    report = Report(
        script="a.session",
        told=(
            _played(steps[0], held=True, seen="arm-1"),
            _played(steps[1], held=False, seen="Busy: wait"),
        ),
        wall_s=0.5,
        left=("ls",),
    )
    suite = _suite(junit.of_report(report))
    counts = {name: suite.get(name) for name in ("tests", "failures", "errors", "skipped", "time")}
    assert counts == {"tests": "3", "failures": "1", "errors": "0", "skipped": "1", "time": "0.500"}
    first, second, third = suite.findall("testcase")
    assert (first.get("name"), first.findtext("system-out"), first.get("time")) == (
        "line 1: ls",
        "arm-1",
        "0.250",
    )
    failure = second.find("failure")
    assert failure is not None
    assert failure.get("message") == "Busy: wait"
    assert third.find("skipped") is not None


@given(seen=st.text())
def test_every_text_of_a_robot_gives_a_report_that_can_be_read(seen: str) -> None:
    (step,) = read("ls\n", "a.session").steps
    report = Report(script="a.session", told=(_played(step, held=False, seen=seen),))
    assert _suite(junit.of_report(report)).find("testcase/failure") is not None


def test_a_session_that_cannot_be_understood_is_reported_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script, report = tmp_path / "a.session", tmp_path / "a.xml"
    script.write_text("stop\nenslav a b\n")
    assert main(["run", str(script), "--junit", str(report)]) == USAGE
    assert "line 2" in capsys.readouterr().err
    (case,) = _suite(report.read_bytes()).findall("testcase")
    assert case.get("name") == "line 2"
    error = case.find("error")
    assert error is not None
    assert "enslave" in (error.get("message") or "")


@pytest.mark.usefixtures("place")
def test_a_report_that_cannot_be_written_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "a.session"
    script.write_text("sleep 1ms\n")
    assert main(["run", str(script), "--junit", str(tmp_path / "none" / "a.xml")]) == REFUSED
    assert "cannot write the report" in capsys.readouterr().err
