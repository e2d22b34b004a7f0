"""Agents, keys and helps read as text: units and results as people write them, in each language."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.text import Text

from robotree.tui import words
from robotree.tui.errors import NoSuchLanguage
from robotree.tui.line.actions import ACTIONS
from robotree.tui.line.manual import overview, page, shell
from robotree.tui.line.page_keys import PAGE_KEYS
from robotree.tui.screen.hanging import containing
from robotree.tui.screen.jog import bounds
from robotree.tui.seen import wording
from robotree.tui.seen.status import COUNTED, STATUSES
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription
from robotree.vr.base.readable import number


def field(name: str = "x", **changes: object) -> FieldSpec:
    return FieldSpec(**{"name": name, "type": "float", "unit": "m", **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        (field(lower=-0.7, upper=0.7), "-0.7 … 0.7 m"),
        (field(lower=0.0), "≥ 0 m"),
        (field(upper=3.0, unit=""), "≤ 3"),
        (field(), "m"),
    ],
)
def test_a_range_is_written_in_its_unit(spec: FieldSpec, text: str) -> None:
    assert wording.span(spec) == text


def test_a_signature_names_units_choices_and_defaults() -> None:
    action = field("action", type="choice", unit="", choices=("open", "close"))
    speed = field("speed", unit="m/s", required=False, default=0.1)
    command = CommandSpec(name="grip", parameters=(action, speed))
    assert wording.signature(command) == "grip(action: open|close, speed: m/s = 0.1)"


def test_a_result_has_units_where_they_are_known() -> None:
    command = CommandSpec(name="look", result=(field("x"), field("n", unit="")))
    assert wording.result(command.result, {"x": 0.25, "n": 3.0, "more": [1, 2]}) == [
        ("x", "0.25 m"),
        ("n", "3"),
        ("more", "1, 2"),
    ]
    assert wording.result((field("", unit="N"),), 6.5) == [("", "6.5 N")]
    joints = FieldSpec(name="joints", type="list", items=(field("", unit="rad"),))
    turned = CommandSpec(name="turned", result=(field("twist", unit="rad"), joints))
    assert wording.result(turned.result, {"twist": math.pi / 4, "joints": [0.0, math.pi]}) == [
        ("twist", "45 °"),
        ("joints", "0, 180 °"),
    ]
    assert wording.result((), None) == []
    assert wording.result((), True) == [("", "yes")]


@given(value=st.floats(allow_nan=True, allow_infinity=True))
def test_any_number_can_be_written(value: float) -> None:
    assert len(number(value)) < 14
    assert number(0.0) == number(-0.0) == number(1e-12) == "0"


def test_columns_align_and_end_ragged() -> None:
    assert wording.columns([("a", "bb", "c"), ("aaa", "b", "")]) == "a    bb  c\naaa  b"
    assert wording.columns([]) == ""


def robot(*commands: CommandSpec) -> RobotDescription:
    return RobotDescription(address=Address("robot", "a", "1"), kinds=("Arm", "Robot"), commands=commands)


def test_a_robot_is_tele_operable_that_goes_to_points_and_tells_where_it_is() -> None:
    axes = tuple(field(name, lower=-1.0, upper=1.0) for name in ("x", "y", "z", "twist"))
    info = CommandSpec(name="get_info", effect="read")
    go_to = CommandSpec(name="go_to", parameters=(*axes, field("speed", required=False)))
    assert bounds(robot(go_to, info)) == dict.fromkeys(("x", "y", "z", "twist"), (-1.0, 1.0))
    assert bounds(robot(go_to)) is None
    assert bounds(robot(CommandSpec(name="go_to", parameters=axes[:3]), info)) is None
    assert bounds(robot(CommandSpec(name="go_to", parameters=(*axes, field("must"))), info)) is None
    assert (
        bounds(robot(CommandSpec(name="go_to", parameters=axes, through="arm.go_to", available=False), info))
        is None
    )


def test_the_manual_fits_into_a_terminal_and_explains_every_verb() -> None:
    text = overview(shell())
    assert max(map(len, text.splitlines())) <= 110
    for verb in ("ls", "enslave", "call", "demo", "run", "sim", "supervise"):
        assert verb in text
        assert f"usage: robotree {verb}" in page(verb)


def test_a_stop_is_resumed_and_only_a_child_is_released() -> None:
    from robotree.tui.line.actions import ACTIONS

    assert {action.verb for action in ACTIONS if "release" in action.help.lower()} <= {
        "release",
        "delete",
        "may",
    }
    resume = page("resume").lower()
    assert "resume after a protective stop" in resume
    assert "release" not in resume


# -- the words of the screen in each language: none is missing, none is too much, and they fit -----

OTHERS = sorted(words.LANGUAGES.keys() - {"en"})
LABELS = {one.label for one in (*ACTIONS, *PAGE_KEYS) if one.label}
USED = {*words.TEXTS, *STATUSES, *COUNTED.values()} | LABELS


@pytest.mark.parametrize("code", OTHERS)
def test_each_text_is_there_in_each_language_and_no_other(code: str) -> None:
    found = words.lexicon(code)
    assert sorted(USED - found.keys()) == [], "missing"
    assert sorted(found.keys() - USED) == [], "of no use"
    for english, text in found.items():
        assert text.strip() == text
        assert text
        assert sorted(re.findall(r"\{\w+\}", text)) == sorted(re.findall(r"\{\w+\}", english)), english


@pytest.mark.parametrize("code", words.LANGUAGES)
def test_no_word_is_much_longer_than_its_place(code: str) -> None:
    words.choose(code)
    for text in USED & {*words.TEXTS, *STATUSES}:
        if "{" not in text and len(text) < 20:
            assert cell_len(words.say(text)) <= len(text) + 12, text
    labels = {one.label for one in (*ACTIONS, *PAGE_KEYS) if one.label}
    assert max(cell_len(words.say(label)) for label in labels) <= 14


def test_arabic_is_drawn_from_right_to_left_with_its_letters_joined_and_names_as_they_are() -> None:
    words.choose("ar")
    assert words.say("Delete") == "\ufed1\ufeac\ufea3", "feh, dhal, hah: alone, final, initial"
    assert words.say("under {name}", name="arm-1") == f"arm-1 {words.say('under {name}', name='')[-3:]}"
    assert words.say_state("under arm-1").startswith("arm-1 ")
    assert words.say("proxy arm-1 …") == "proxy arm-1 …", "what is no text of ours stays"


def test_a_language_that_there_is_not_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(NoSuchLanguage, match="no language 'xx'; there are en, de, ar"):
        words.choose("xx")
    assert words.chosen() == "en"


# -- a search leaves of a text the lines with the letters, and what they belong to -----------------

HELP = """\
On every page
  space      stops every robot
  ?          help
Verbs
  stop [NAME]
      Stop all robots, or one.
  tree
      Show the robots as trees.
"""


@pytest.mark.parametrize(
    ("letters", "kept"),
    [
        ("HELP", ["On every page", "  ?          help"]),
        ("tree", ["Verbs", "  tree", "      Show the robots as trees."]),
        ("or one", ["Verbs", "  stop [NAME]", "      Stop all robots, or one."]),
        ("nothing like it", [""]),
    ],
)
def test_a_line_is_kept_with_its_title_and_what_explains_it(letters: str, kept: list[str]) -> None:
    assert containing(Text(HELP), letters).plain.split("\n") == kept


@given(text=st.text("ab \n", max_size=60), letters=st.text("ab", min_size=1, max_size=3))
def test_a_search_adds_no_line_and_loses_none_that_has_the_letters(text: str, letters: str) -> None:
    found = containing(Text(text), letters).plain.split("\n")
    lines = text.split("\n")
    assert len(found) <= len(lines)
    assert [line for line in lines if letters in line] == [line for line in found if letters in line]
