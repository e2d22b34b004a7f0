"""A session is understood as a whole before anything moves, told step by step, and refused with its line."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.errors import BadScript, ValueRefused
from robotree.tui.session import conditions
from robotree.tui.session import script as session
from robotree.tui.session.conditions import Scene, condition
from robotree.tui.session.script import Do, Expect, PlayedStep, Report, Sleep, read, transcript
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec

SCRIPT = """\
# closes the lever
create examples/move_to.py as mover

enslave mover.arm arm-1     # the arm is free
expect arm-1 enslaved by mover.arm within 2s
expect result = 'very true'
try call arm-1.go_to x=0.4
expect refused NotInControl
sleep 500ms
"""


def test_a_script_is_the_verbs_one_per_line() -> None:
    steps = read(SCRIPT, "a.session").steps
    assert [step.number for step in steps] == [2, 4, 5, 6, 7, 8, 9]
    assert [type(step.deed) for step in steps] == [Do, Do, Expect, Expect, Do, Expect, Sleep]
    assert isinstance(steps[2].deed, Expect)
    assert steps[2].deed.within == 2.0
    assert steps[2].deed.condition.text == "arm-1 enslaved by mover.arm"
    assert isinstance(steps[4].deed, Do)
    assert steps[4].deed.may_fail
    assert steps[6].deed == Sleep(0.5)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("enslav mover.arm arm-1", "did you mean enslave"),
        ("enslave mover.arm", "CHILD is missing"),
        ("expect mover flies", "is no condition"),
        ("expect mover listed within soon", "is no duration"),
        ("sleep", "is no duration"),
        ("try", "names no verb"),
        ("call 'a.b", "no closing quotation"),
        ("sim arm --listen tcp:127.0.0.1:1", "no verb 'sim'"),
        ("run other.session", "no verb 'run'"),
    ],
)
def test_the_first_line_that_cannot_be_understood_is_named(line: str, reason: str) -> None:
    with pytest.raises(BadScript) as refusal:
        read(f"stop\n{line}\n", "a.session")
    assert refusal.value.number == 2
    assert reason in str(refusal.value)
    assert str(refusal.value).startswith("a.session, line 2: ")


def test_all_mistakes_of_a_script_are_named_at_once() -> None:
    text = "enslav a b\nstop\ncall a.b --within soon\ncreate no.py as x\ntry create no.py as y\ndelete a/b\n"
    text += "run x\n"
    with pytest.raises(BadScript) as refusal:
        read(text, "a.session", exists=lambda path: path != "no.py")
    assert [number for number, _ in refusal.value.mistakes] == [1, 3, 4, 6, 7]
    assert [line.split(":")[0] for line in str(refusal.value).splitlines()] == [
        f"a.session, line {number}" for number in (1, 3, 4, 6, 7)
    ]
    assert "it is for a shell: `robotree run x`" in str(refusal.value)


def test_who_may_only_look_plays_no_script_that_changes_robots() -> None:
    assert read("expect arm-1 listed\nshow arm-1\nstop\n", "a", readonly=True).steps
    with pytest.raises(BadScript, match="line 2: no verb 'enslave': this is read-only"):
        read("stop\nenslave mover.arm arm-1\n", "a", readonly=True)


def told(*, held: bool, seen: str = "") -> PlayedStep:
    return PlayedStep(step=read("stop", "a").steps[0], held=held, seen=seen, began=1.234, took=0.1)


def test_a_report_is_good_only_when_all_was_played_and_held() -> None:
    assert Report(script="a", told=(told(held=True),)).ok
    assert not Report(script="a", told=(told(held=True), told(held=False))).ok
    assert not Report(script="a", told=(told(held=True),), left=("stop",)).ok


def test_a_transcript_shows_when_what_and_how_it_went() -> None:
    assert transcript(told(held=True, seen="stopped: arm-1")) == "   1.23 s  ✓  stop  → stopped: arm-1"
    assert transcript(told(held=False)) == "   1.23 s  ✗  stop"
    assert transcript(told(held=True, seen="x 1\ny 2")).splitlines()[1:] == [
        " " * 14 + "x 1",
        " " * 14 + "y 2",
    ]


def test_the_manual_is_a_script() -> None:
    for module in (session, conditions):
        lines = [line.strip() for line in (module.__doc__ or "").splitlines() if line.startswith("    ")]
        text = "\n".join(re.split(r"\s{4,}", line)[0] for line in lines)
        assert len(read(text, "the manual").steps) >= 9


# -- scripts that name what is not there: each is refused before it leads a robot, with its line ---

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


# -- what a session can expect, and when it holds --------------------------------------------------

MOVER = Address("robot", "mover", "1")
ARM = Address("robot", "arm-1", "2")


def mover(child: Address | None = ARM, busy: str = "") -> RobotDescription:
    slot = SlotSpec(name="arm", kind="Arm", child=child)
    return RobotDescription(
        address=MOVER, kinds=("MoveTo", "VirtualRobot", "Robot"), slots=(slot,), busy=busy
    )


def arm(*, free: bool = False) -> RobotDescription:
    bond = None if free else BondSpec(parent=MOVER, slot="arm", epoch=3, remaining=4.0)
    return RobotDescription(address=ARM, kinds=("Arm", "Robot"), bond=bond)


def scene(
    *robots: RobotDescription, listed: tuple[str, ...] = (), result: Any = None, refusal: str = ""
) -> Scene:
    return Scene(
        listed=frozenset(listed),
        robots={robot.name: robot for robot in robots},
        readings={"cell": {"lever_angle": 0.8}},
        result=result,
        refusal=refusal,
    )


@pytest.mark.parametrize(
    ("text", "there", "seen"),
    [
        ("arm-1 listed", scene(listed=("arm-1",)), None),
        ("arm-1 gone", scene(), None),
        ("arm-1 enslaved by mover.arm", scene(arm()), None),
        ("mover.arm holds arm-1", scene(mover()), None),
        ("mover.arm empty", scene(mover(child=None)), None),
        ("mover idle", scene(mover()), None),
        ("reading cell.lever_angle > 0.75", scene(), None),
        ("reading cell.lever_angle=0.8", scene(), None),
        ("result.z >= 0.29", scene(result={"z": 0.3}), None),
        ("result = 0.3", scene(result=0.3000001), None),
        ("result.pose.x < 1", scene(result={"pose": {"x": 0}}), None),
        ("result = closed", scene(result="closed"), None),
        ("result = true", scene(result=True), None),
        ("result != 3", scene(result=4), None),
        ("refused", scene(refusal="NotInControl"), None),
        ("refused NotInControl", scene(refusal="NotInControl"), None),
        ("done", scene(), None),
        ("arm-1 listed", scene(), "not listed"),
        ("arm-1 gone", scene(arm()), "there"),
        ("arm-1 gone", scene(listed=("arm-1",)), "there"),
        ("arm-1 enslaved by mover.arm", scene(arm(free=True)), "free"),
        ("arm-1 enslaved by mover.arm", scene(), "arm-1 does not answer"),
        ("arm-1 enslaved by other.arm", scene(arm()), "enslaved by mover.arm"),
        ("mover.arm empty", scene(mover()), "holds arm-1"),
        ("mover.leg empty", scene(mover()), "mover has no slot leg"),
        ("mover.arm holds arm-2", scene(mover()), "holds arm-1"),
        ("mover idle", scene(mover(busy="move")), "busy: move"),
        ("reading cell.lever_angle < 0.75", scene(), "0.8"),
        ("reading cell.height > 0", scene(), "cell has no reading height; it has lever_angle"),
        ("reading hall.height > 0", scene(), "hall reports nothing"),
        ("result.z > 0", scene(result={"x": 1}), "the result is x 1"),
        ("result > 0", scene(result="closed"), "closed cannot be compared with 0"),
        ("refused StaleEpoch", scene(refusal="NotInControl"), "NotInControl"),
        ("refused", scene(), "done"),
    ],
)
def test_a_condition_holds_where_it_should_and_else_says_what_was_seen(
    text: str, there: Scene, seen: str | None
) -> None:
    verdict = condition(text).judge(there)
    assert verdict.holds == (seen is None)
    assert seen in {None, verdict.seen}


@pytest.mark.parametrize(
    "text", ["", "arm-1", "arm-1 enslaved by mover", "reading cell.x > high", "result >", "arm-1 lost"]
)
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(ValueRefused, match="expect"):
        condition(text)


@given(number=st.floats(-1e6, 1e6), bound=st.floats(-1e6, 1e6))
def test_larger_and_not_larger_exclude_each_other(number: float, bound: float) -> None:
    there = Scene(result=number)
    larger = condition(f"result > {bound!r}").judge(there).holds
    assert larger != condition(f"result <= {bound!r}").judge(there).holds
    assert larger == (number > bound)


def test_what_is_expected_of_a_group_is_judged_of_each_member() -> None:
    idle, busy = arm(free=True), mover(busy="move")
    robots = {robot.name: robot for robot in (idle, busy)}
    both = Scene(
        robots=robots,
        readings={"arm-1": {"battery": 40.0}, "mover": {"battery": 20.0}},
        groups={"team": ("arm-1", "mover"), "nobody": ()},
    )
    holds = {
        "all of team idle": False,
        "any of team idle": True,
        "all of team reading battery > 30": False,
        "all of team reading battery > 10": True,
        "any of team enslaved by mover.arm": False,
        "all of nobody idle": False,
        "all of strangers idle": False,
    }
    assert {text: condition(text).judge(both).holds for text in holds} == holds
    assert "mover: busy: move" in condition("all of team idle").judge(both).seen
    assert condition("all of team idle").group == "team"
    with pytest.raises(ValueRefused):
        condition("all of team happy")
