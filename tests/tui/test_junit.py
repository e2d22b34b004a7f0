"""A session leaves a report that test servers read."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.cli import main
from robotree.tui.exit_codes import REFUSED, USAGE
from robotree.tui.session import junit
from robotree.tui.session.script import PlayedStep, Report, Step, read


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
