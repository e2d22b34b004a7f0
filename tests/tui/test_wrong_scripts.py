"""Scripts that name what is not there: each is refused before it leads a robot, with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main

HEAD = """\
script: s
partners:
  robot: {kind: Companion, needs: [say, juggle]}
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
}
ACTIONS = {
    "do: robot.dance": "a Companion has no command 'dance'",
    "do: [robot, go_to, sofa, 9]": "speed",
    "do: [robot, go_to, sofa, 0.5, 3]": "go_to takes 2 values: place, speed",
    "do: [robot, say, {txet: hello}]": "say has no argument 'txet'; do you mean 'text'?",
    "do: robot.say": "say needs text",
    "do: [robot, wave, often]": "times",
    "role: {robot: chidl}": "there is no role 'chidl'; do you mean 'child'?",
    "role: {robbot: child}": "there is no partner 'robbot'; do you mean 'robot'?",
}
EXPERTS = {
    "(do robot dance)": "a Companion has no command 'dance'",
    "(do robt say hello)": "there is no partner 'robt'; do you mean 'robot'?",
    "(do-as c robot go_to place= sofa speed= 9)": "speed",
    "(play robot chidl)": "there is no role 'chidl'; do you mean 'child'?",
}


def refused(text: str, path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    path.write_text(text)
    assert main(["rules", "check", str(path)]) != exit_codes.DONE
    return capsys.readouterr().err


@pytest.mark.parametrize(("condition", "says"), CONDITIONS.items())
def test_a_condition_that_can_never_be_met_is_refused_with_its_line(
    condition: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = HEAD.replace("CONDITION", condition).replace("ACTION", "wait: {name: comes, for: 5 s}")
    error = refused(text, tmp_path / "s.yaml", capsys)
    assert says in error
    assert "s.yaml:8:" in error


@pytest.mark.parametrize(("action", "says"), ACTIONS.items())
def test_an_action_that_no_partner_can_carry_out_is_refused_with_its_line(
    action: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = HEAD.replace("CONDITION", "start").replace("ACTION", action)
    error = refused(text, tmp_path / "s.yaml", capsys)
    assert says in error
    assert "s.yaml:10:" in error


@pytest.mark.parametrize(("action", "says"), EXPERTS.items())
def test_rules_of_clips_are_refused_for_the_same_mistakes(
    action: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refused(CLP.replace("ACTION", action), tmp_path / "s.clp", capsys)
    assert says in error
    assert "s.clp:4:" in error


@pytest.mark.parametrize(
    "action", ["do: robot.juggle", "do: [robot, say, $who]", "do: [robot, wave, 3]", "role: {robot: waiter}"]
)
def test_what_a_partner_needs_or_may_have_learned_is_let_through(
    action: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(HEAD.replace("CONDITION", "bell: {who: $who}").replace("ACTION", action))
    assert main(["rules", "check", str(path)]) == exit_codes.DONE, capsys.readouterr().err
