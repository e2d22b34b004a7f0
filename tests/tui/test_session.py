"""A session is understood as a whole before anything moves, and told step by step."""

from __future__ import annotations

import re

import pytest

from robotree.tui.errors import BadScript
from robotree.tui.session import conditions
from robotree.tui.session import script as session
from robotree.tui.session.script import Do, Expect, PlayedStep, Report, Sleep, read, transcript

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
