"""Scripts that name what is not there: each is refused before it leads a robot, with its line."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main

HEAD = """\
script: s
partners:
  robot: {kind: Companion, needs: [say, juggle]}
parameters: {slow: slowly}
hears: {bell: {who: text}}
rules:
  - rule: r
    when:
      - CONDITION
    then:
      - ACTION
"""
CLP = """\
(defscript s (partner robot (kind Companion)))
(defrule r
  (msg (act start))
  => ACTION)
"""
CONDITIONS = {
    "done: {partner: robot, act: sya}": "a Companion has no command 'sya'; do you mean 'say'?",
    "failed: {partner: robot, act: go_too}": "a Companion has no command 'go_too'; do you mean 'go_to'?",
    "progress: {partner: robot, act: wav}": "a Companion has no command 'wav'; do you mean 'wave'?",
    "done: {partner: robbot}": "there is no partner 'robbot'; do you mean 'robot'?",
    "lost: robt": "there is no partner 'robt'; do you mean 'robot'?",
    "timer: comse": "no rule waits for the timer 'comse'",
    "partner: {name: robbot}": "there is no partner 'robbot'; do you mean 'robot'?",
    "role: {partner: robot, name: chidl}": "there is no role 'chidl'; do you mean 'child'?",
    "stopped: robt": "there is no partner 'robt'; do you mean 'robot'?",
    "bel: {who: $w}": "there is no fact or message 'bel'; do you mean 'bell'?",
    "tmier: comes": "there is no fact or message 'tmier'; do you mean 'timer'?",
}
ACTIONS = {
    "do: robot.dance": "a Companion has no command 'dance'",
    "do: [robot, go_to, sofa, 9]": "speed",
    "do: [robot, go_to, sofa, 0.5, 3]": "go_to takes 2 values: place, speed",
    "do: [robot, say, {txet: hello}]": "say has no argument 'txet'; do you mean 'text'?",
    "do: robot.say": "say needs text",
    "do: [robot, wave, often]": "times",
    "do: [robot, go_to, sofaa]": "place: 'sofaa' is not one of door, sofa, table, shelf, middle, dock; do you mean 'sofa'?",  # noqa: E501
    "do: [robot, take, blue cpu]": "do you mean 'blue cup'?",
    "do: [robot, go_to, cellar]": "write `takes: {place: [cellar]}` at the partner",
    "wiat: {name: comes, for: 5 s}": "there is no action 'wiat'; do you mean 'wait'?",
    "wait: {name: comes, for: $slow}": "'slowly ($slow)' is no time: write it as `5 s`",
    "role: {robot: chidl}": "there is no role 'chidl'; do you mean 'child'?",
    "role: {robbot: child}": "there is no partner 'robbot'; do you mean 'robot'?",
}
EXPERTS = {
    "(do robot dance)": "a Companion has no command 'dance'",
    "(do robt say hello)": "there is no partner 'robt'; do you mean 'robot'?",
    "(do-as c robot go_to place= sofa speed= 9)": "speed",
    "(play robot chidl)": "there is no role 'chidl'; do you mean 'child'?",
}

MEETS = {
    "(msg (act done) (from robot) (args sya))": "a Companion has no command 'sya'; do you mean 'say'?",
    "(msg (perf failure) (act dacne))": "a Companion has no command 'dacne'",
    "(msg (act timer) (args comse))": "no rule waits for the timer 'comse'; do you mean 'comes'?",
    "(msg (act lost) (from robt))": "there is no partner 'robt'; do you mean 'robot'?",
    "(role (partner robot) (name chidl))": "there is no role 'chidl'; do you mean 'child'?",
    "(partner (name robt))": "there is no partner 'robt'; do you mean 'robot'?",
}
TABLE = """\
script: s.yaml
tests:
  - test: one
    roles: {robot: child}
    steps:
      - when: WHEN
        then: THEN
"""
WHENS = {
    "comse tim": "the script does not hear 'comse'; do you mean 'comes'?",
    "done robt say": "there is no partner 'robt'; do you mean 'robot'?",
    "done robot sya": "a Companion has no command 'sya'; do you mean 'say'?",
    "failed robot dacne": "a Companion has no command 'dacne'",
    "stopped robt": "there is no partner 'robt'",
    "timer comse": "no rule waits for the timer 'comse'; do you mean 'comes'?",
    "role robot chidl": "there is no role 'chidl'; do you mean 'child'?",
}
THENS = {
    "do robt say text=x": "there is no partner 'robt'; do you mean 'robot'?",
    "do robot sya text=x": "a Companion has no command 'sya'; do you mean 'say'?",
    "do robot say txet=x": "say has no argument 'txet'; do you mean 'text'?",
    "do robot go_to place=sofaa": "do you mean 'sofa'?",
    "role robot chidl": "there is no role 'chidl'; do you mean 'child'?",
    "wait comse 5": "no rule waits for the timer 'comse'; do you mean 'comes'?",
    "doo robot wave": "'doo' is no order; do you mean 'do'?",
}


def refused(text: str, path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    path.write_text(text)
    assert main(["rules", "check", str(path)]) != exit_codes.DONE
    return capsys.readouterr().err


WRONG = (
    ("s.yaml:9:", HEAD.replace("ACTION", "wait: {name: comes, for: 5 s}"), "CONDITION", CONDITIONS),
    ("s.yaml:11:", HEAD.replace("CONDITION", "start"), "ACTION", ACTIONS),
    ("s.clp:4:", CLP, "ACTION", EXPERTS),
    ("s.clp:3:", CLP.replace("ACTION", "(wait comes 5)"), "(msg (act start))", MEETS),
)
"""File and line of a mistake, the script, what of it is replaced, and by what, with what is said then."""


@pytest.mark.parametrize(
    ("place", "text", "says"),
    [
        (place, text.replace(blank, mistake), says)
        for place, text, blank, mistakes in WRONG
        for mistake, says in mistakes.items()
    ],
)
def test_what_can_never_be_met_or_carried_out_is_refused_with_its_line(
    place: str, text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refused(text, tmp_path / place.partition(":")[0], capsys)
    assert says in error
    assert place in error


@pytest.mark.parametrize(
    ("kind", "action", "advice"),
    [
        ("Companion", "do: robot.juggle", ""),
        ("Companion", "do: [robot, say, $who]", ""),
        ("Companion", "do: [robot, wave, 3]", ""),
        ("Companion", "role: {robot: waiter}", ""),
        ("Companoin", "log: hello", "which does not come with robotree; do you mean 'Companion'?"),
        ("Sieve", "log: hello", ""),
    ],
)
def test_what_a_partner_may_have_learned_or_a_page_may_bring_is_let_through(
    kind: str, action: str, advice: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.yaml"
    text = HEAD.replace("Companion", kind).replace("CONDITION", "bell: {who: $who}")
    path.write_text(text.replace("ACTION", action))
    assert main(["rules", "check", str(path)]) == exit_codes.DONE, capsys.readouterr().err
    said = capsys.readouterr().out
    assert advice in said
    assert ("do you mean" in said) == bool(advice)


def table(folder: Path, when: str, then: str) -> str:
    script = HEAD.replace("bell", "comes").replace("CONDITION", "comes: {who: $w}")
    (folder / "s.yaml").write_text(
        script.replace("ACTION", "wait: {name: comes, for: 5 s}").replace("slowly", "5")
    )
    path = folder / "s.test.yaml"
    path.write_text(TABLE.replace("WHEN", when).replace("THEN", then))
    return str(path)


@pytest.mark.parametrize(
    ("when", "then", "says"),
    [(when, "nothing", says) for when, says in WHENS.items()]
    + [("comes tim", then, says) for then, says in THENS.items()],
)
def test_a_table_of_tests_is_refused_for_the_same_mistakes(
    when: str, then: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rules", "test", table(tmp_path, when, then)]) != exit_codes.DONE
    error = capsys.readouterr().err
    assert says in error
    assert "s.test.yaml:6:" in error


def test_a_table_without_mistakes_is_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "test", table(tmp_path, "comes tim", "wait comes 5")]) == exit_codes.DONE
    assert "1 of 1 passed" in capsys.readouterr().out


def test_a_place_that_the_robot_of_another_flat_knows_is_written_at_the_partner(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.yaml"
    text = HEAD.replace("juggle]", "juggle], takes: {place: [cellar]}").replace("slowly", "5")
    text = text.replace("CONDITION", "start")
    path.write_text(text.replace("ACTION", "do: [robot, go_to, cellar]"))
    assert main(["rules", "check", str(path)]) == exit_codes.DONE, capsys.readouterr().err
    assert "do you mean 'cellar'?" in refused(
        text.replace("ACTION", "do: [robot, go_to, celar]"), path, capsys
    )


ENDS = """\
script: s
hears: {bell: {}, bye: {}}
rules:
  - rule: greet
    when: [bell: {}]
    then: [log: hello]
  - rule: leave
    when: [bye: {}]
    then: [end: done]
"""


@pytest.mark.parametrize(
    ("rule", "says"),
    [("gret", "there is no rule 'gret'; do you mean 'greet'?"), ("xyz", "'xyz'; there are: greet, leave")],
)
def test_an_unknown_rule_is_refused_as_a_wrong_line_is(
    rule: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(ENDS)
    assert main(["rules", "explain", str(path), rule]) == exit_codes.USAGE
    said = capsys.readouterr()
    assert says in said.err
    assert said.out == ""


def test_a_dry_run_says_that_the_script_has_ended_and_fires_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(ENDS)
    monkeypatch.setattr("sys.stdin", io.StringIO("bell\nbye\nbell\n"))
    assert main(["rules", "dry-run", str(path)]) == exit_codes.DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[-4:-2] == ["  leave fires", "  → end done"]
    assert lines[-2] == "> bell"
    assert lines[-1].startswith("  ✗ the script has ended")
    assert lines.count("  greet fires") == 1
