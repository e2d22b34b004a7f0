"""Trials: values with names, tables, rounds, limits, and what is for the case that a step fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from robotree.tui.cli import main
from robotree.tui.errors import BadScript, ValueRefused
from robotree.tui.session import faults, junit
from robotree.tui.session.script import Do, Later, Report, Sleep, read
from robotree.tui.session.suite import Collected, Tried, collected, selection
from tests.tui.conftest import EXAMPLES, play

if TYPE_CHECKING:
    from conftest import Realm


def mistakes(text: str) -> dict[int, str]:
    with pytest.raises(BadScript) as refusal:
        read(text, "a.session")
    return dict(refusal.value.mistakes)


def texts(text: str) -> list[list[str]]:
    """The words of the calls of each trial, with the values in their places."""
    return [
        [
            " ".join(node.deed.line.many("PARAMETER=VALUE"))
            for node in trial.nodes
            if not hasattr(node, "body") and isinstance(node.deed, Do)  # type: ignore[union-attr]
        ]
        for trial in read(text, "a").trials
    ]


def test_each_row_of_a_table_is_a_run() -> None:
    script = "table\n x z\n 1 2\n 3 4\nend\ncall arm-1.go_to x=$x z=${z}\n"
    assert texts(script) == [["x=1 z=2"], ["x=3 z=4"]]
    assert [trial.name for trial in read(script, "a").trials] == ["[1-2]", "[3-4]"]


def test_the_tables_of_a_file_and_of_a_trial_are_combined() -> None:
    script = "table\n x\n 1\n 2\nend\ntrial go\ntable\n y\n 5\n 6\nend\ncall a.b x=$x y=$y\n"
    assert texts(script) == [["x=1 y=5"], ["x=1 y=6"], ["x=2 y=5"], ["x=2 y=6"]]
    assert read(script, "a").trials[3].name == "go[2-6]"


def test_lines_before_the_first_trial_belong_to_each() -> None:
    trials = read("let x = 4\ncall a.b x=$x\ntrial one\nstop\ntrial two\nresume\n", "a").trials
    assert [trial.name for trial in trials] == ["one", "two"]
    assert [[node.text for node in trial.nodes] for trial in trials] == [
        ["call a.b x=$x", "stop"],
        ["call a.b x=$x", "resume"],
    ]


def test_a_value_is_one_word_whatever_is_in_it() -> None:
    (trial,) = read("table\n t\n 'a --force; stop'\nend\ncall a.b text=$t\nsleep 1s\n", "a").trials
    first, second = trial.nodes
    assert not hasattr(first, "body")
    assert isinstance(first.deed, Do)  # type: ignore[union-attr]
    assert first.deed.line.many("PARAMETER=VALUE") == ("text=a --force; stop",)  # type: ignore[union-attr]
    assert second.deed == Sleep(1.0)  # type: ignore[union-attr]


def test_two_dollar_signs_are_one_and_an_unknown_name_is_a_mistake() -> None:
    assert texts("call a.b text=$$5\n") == [["text=$5"]]
    assert "$x has no value here" in mistakes("call a.b x=$x\n")[1]


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("repeat 2\nstop\n", 1, "has no `end`"),
        ("stop\nend\n", 2, "ends nothing"),
        ("repeat no\nstop\nend\n", 1, "no number of rounds"),
        ("repeat 0\nstop\nend\n", 1, "no number of rounds"),
        ("within soon\nstop\nend\n", 1, "no duration"),
        ("table\n x\nend\n", 1, "rows of values"),
        ("table\n x y\n 1\nend\n", 3, "1 values for 2 names"),
        ("table\n x x\n 1 2\nend\n", 2, "is there twice"),
        ("table\n 1x\n 1\nend\n", 2, "cannot be the name"),
        ("trial\nstop\n", 1, "needs a name"),
        ("trial a\nstop\ntrial a\nstop\n", 3, "already"),
        ("repeat 2\ntrial a\nend\n", 2, "inside a block"),
        ("repeat 2\non failure\nend\nend\n", 2, "inside a block"),
        ("let x 3\n", 1, "write let NAME = VALUE"),
        ("let x = result\ncal arm-1.hold x=$x\n", 2, "did you mean call"),
        ("repeat 2\nenslav a b\nend\n", 2, "did you mean enslave"),
    ],
)
def test_a_wrong_line_is_named(text: str, line: int, reason: str) -> None:
    assert reason in mistakes(text)[line]


def test_a_line_with_a_measured_value_waits_for_it() -> None:
    _, step = read("let x = reading arm-1.x\ncall arm-1.go_to x=$x\n", "a").steps
    assert isinstance(step.deed, Later)


async def test_what_was_measured_is_used(realm: Realm) -> None:
    report, told = await play(
        realm,
        """
        let x = reading arm-1.x
        call arm-1.get_info
        let z = result.z
        call arm-1.go_to x=$x y=0.1 z=$z twist=0
        expect reading arm-1.z = $z
        expect reading arm-1.y = 0.1
        """,
    )
    assert report.ok, told[-1].seen
    assert told[0].seen == "x is 0.35"


async def test_what_cannot_be_measured_is_said(realm: Realm) -> None:
    report, told = await play(realm, "let x = reading arm-1.nose\n")
    assert not report.ok
    assert "arm-1 has no reading nose" in told[0].seen
    report, told = await play(realm, "call arm-1.hold\nlet x = result.z\n")
    assert not report.ok


async def test_lines_are_repeated(realm: Realm) -> None:
    report, told = await play(
        realm, "repeat 3\ncall arm-1.shout text=no-$round\nexpect result = no-$round\nend\n"
    )
    assert report.ok, told[-1].seen
    assert len(told) == 6


async def test_a_block_that_takes_too_long_ends_and_names_the_line(realm: Realm) -> None:
    report, told = await play(realm, "within 100ms\n  ls\n  sleep 30s\nend\nstop\n")
    assert not report.ok
    assert report.wall_s < 20.0
    assert told[-1].step.number == 1
    assert told[-1].seen == "not over within 0.1 s: line 3 went on, sleep 30s"
    assert report.left == ("stop",)


async def test_what_is_for_a_failure_is_played_then_alone(realm: Realm) -> None:
    after = "on failure\ncall arm-1.stumble\nls\nend\nfinally\nls --views\nend\n"
    report, told = await play(realm, f"call arm-1.hold\n{after}")
    assert report.ok
    assert [each.step.text for each in told] == ["call arm-1.hold", "ls --views"]
    report, told = await play(realm, f"call arm-1.stumble\nstop\n{after}")
    assert not report.ok
    assert [each.step.text for each in told] == [
        "call arm-1.stumble", "call arm-1.stumble", "ls", "ls --views",
    ]  # fmt: skip
    assert report.left == ("stop",)
    assert report.failed is not None
    assert report.failed.step.number == 1


async def test_what_was_measured_in_one_trial_is_unknown_in_the_next(realm: Realm) -> None:
    report, told = await play(realm, "trial a\ncall arm-1.get_info\ntrial b\nexpect result.z > 0\n")
    assert not report.ok
    assert [each.trial for each in told] == ["a", "b"]


async def test_a_drill_of_what_takes_no_part_is_refused(realm: Realm) -> None:
    _, told = await play(realm, "try fault cut arm-1\nexpect refused NoDrill\n")
    assert told[-1].held, told[0].seen
    _, told = await play(realm, "try fault freeze nobody\nexpect refused NoSuchRobot\nfault end\n")
    assert told[-1].seen == "no fault was begun from here"
    assert await faults.end_all(realm.realm_client) == []


@pytest.mark.parametrize(
    ("expression", "fitting"),
    [
        ("", "abc"),
        ("lift", "a"),
        ("LIFT", "a"),
        ("lift or drill", "ab"),
        ("not lift", "bc"),
        ("not (lift or drill)", "c"),
        ("session and not lift", "bc"),
    ],
)
def test_names_are_selected_as_pytest_does(expression: str, fitting: str) -> None:
    names = {"a": "lift.session::lift", "b": "drill.session::cut", "c": "other.session::x[1]"}
    assert [key for key, name in names.items() if selection(expression)(name)] == list(fitting)


@pytest.mark.parametrize("expression", ["and", "lift and", "(lift", "not", "lift )", "lift drill"])
def test_a_wrong_selection_is_refused(expression: str) -> None:
    with pytest.raises(ValueRefused, match="is no expression"):
        selection(expression)


def folder_of(tmp_path: Path, **scripts: str) -> Path:
    for name, text in scripts.items():
        (tmp_path / f"{name}.session").write_text(text)
    return tmp_path


@pytest.mark.usefixtures("place")
def test_a_suite_ends_with_the_codes_of_pytest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder_of(
        tmp_path,
        a="trial one\nsleep 1ms\ntrial two\nexpect x listed within 10ms\nsleep 9s\n",
        b="sleep 1ms\n",
    )
    assert main(["test", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "a.session::two - line 4: expect x listed within 10ms → not within 0.01 s: not listed" in out
    assert "1 failed, 2 passed in " in out
    assert main(["test", str(tmp_path), "-x"]) == 1
    assert "1 failed, 1 passed, 1 not played" in capsys.readouterr().out
    assert main(["test", str(tmp_path), "-k", "not two"]) == 0
    assert "2 passed, 1 not chosen in " in capsys.readouterr().out
    assert main(["test", str(tmp_path / "a.session::one")]) == 0
    assert main(["test", str(tmp_path), "-k", "nothing"]) == 5
    assert main(["test", str(tmp_path / "none")]) == 2
    assert main(["test", f"{tmp_path / 'a.session'}::three"]) == 2
    assert "has no trial 'three'; it has one, two" in capsys.readouterr().err
    (tmp_path / "c.session").write_text("enslav a b\n")
    assert main(["test", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "c.session, line 1" in said.err
    assert "nothing was played" in said.err
    assert said.out == ""


@pytest.mark.usefixtures("place")
def test_a_suite_tells_programs_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder_of(tmp_path, a="trial one\nsleep 1ms\ntrial two\nexpect x listed within 10ms\n")
    report = tmp_path / "a.xml"
    assert main(["test", str(tmp_path), "--json", "--junit", str(report)]) == 1
    data = json.loads(capsys.readouterr().out)
    assert (data["ok"], data["passed"], data["failed"]) == (False, 1, 1)
    assert data["trials"][1]["reason"].startswith("line 4: expect x listed")
    suite = ET.fromstring(report.read_bytes()).find("testsuite")  # noqa: S314 # written by the test itself
    assert suite is not None
    assert (suite.get("tests"), suite.get("failures")) == ("2", "1")
    one, two = suite.findall("testcase")
    assert (one.get("classname"), one.get("name")) == (str(tmp_path / "a.session"), "one")
    failure = two.find("failure")
    assert failure is not None
    assert "line 4" in (failure.get("message") or "")
    assert main(["test", str(tmp_path), "--collect-only", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [
        f"{tmp_path / 'a.session'}::{name}" for name in ("one", "two")
    ]


def test_a_report_has_the_reason_of_what_was_broken_off() -> None:
    script = read("sleep 9s\n", "a.session")
    tried = Tried(Collected("a.session", "a", script, script.trials[0]), Report(script="a"), "interrupted")
    assert not tried.held
    assert b"interrupted" in junit.written("robotree", 1.0, [tried.case])


def test_the_trials_of_the_examples_are_understood() -> None:
    found = list(collected(str(EXAMPLES / "trials"), readonly=False))
    labels = [each.label.rpartition("/")[2] for each in found if isinstance(each, Collected)]
    assert len(labels) == len(found) == 7
    assert "lift.session::there and back[0.3-0.35]" in labels
