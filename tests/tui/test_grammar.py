"""One grammar everywhere: what is written can be read back, and what cannot be read is explained."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.errors import BadLine, UnknownVerb
from robotree.tui.line import grammar
from robotree.tui.line.action import Where
from robotree.tui.line.actions import ACTIONS, shapes
from robotree.tui.line.grammar import Blank, Group, Line, Part, Value, Word

EVERYWHERE = {"json": "", "realm": "NAME", "readonly": ""}
SHAPES = {action.verb: action.shape for action in ACTIONS}
LITERALS = {"as", "on"}

texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=12).filter(
    lambda text: text not in LITERALS
)


def read(text: str) -> Line:
    return grammar.parse(grammar.split(text), SHAPES, EVERYWHERE)


@pytest.mark.parametrize(
    "text", ["it's my turn", "Ben's arm isn't mine", "may I?", "don't -- go", "the 5'' bolt, it's #3"]
)
def test_what_is_said_is_taken_as_it_is_typed(text: str) -> None:
    assert " ".join(read(f"say {text}").many("TEXT")) == text
    line = Line("say", {"TEXT": (text,)})
    assert read(grammar.form(line, SHAPES)) == line


def test_quotes_around_what_is_said_hold_it_together() -> None:
    assert read("say 'I leave for lunch'").many("TEXT") == ("I leave for lunch",)
    assert read("say hello  # in a session, this is a comment").many("TEXT") == ("hello",)


@st.composite
def filled(draw: st.DrawFn, parts: tuple[Part, ...]) -> dict[str, Value]:
    found: dict[str, Value] = {}
    left_out = False
    """Whether a blank may be left out and is: the next value would be taken for it."""
    for part in parts:
        match part:
            case Word():
                pass
            case Blank(name, repeated=True):
                found[name] = tuple(draw(st.lists(texts, min_size=1, max_size=3)))
            case Blank(name):
                found[name] = draw(texts)
            case Group(inner):
                bare = isinstance(inner[0], Blank)
                if not (bare and left_out) and draw(st.booleans()):
                    found |= draw(filled(inner))
                else:
                    left_out = left_out or bare
    return found


@st.composite
def lines(draw: st.DrawFn) -> Line:
    shape = draw(st.sampled_from(sorted(SHAPES.values(), key=lambda one: one.verb)))
    values: dict[str, Value] = {}
    for name, takes in {**EVERYWHERE, **shape.options}.items():
        if draw(st.booleans()):
            values[f"--{name}"] = draw(texts) if takes else True
    for choice in {*shape.rivals, *shape.needed}:
        kept = draw(st.sampled_from(choice))
        values = {name: value for name, value in values.items() if name[2:] not in {*choice} - {kept}}
        if choice in shape.needed:
            values[f"--{kept}"] = draw(texts)
    return Line(shape.verb, {**values, **draw(filled(shape.parts))})


@given(line=lines())
def test_what_is_written_is_read_back(line: Line) -> None:
    assert read(grammar.form(line, SHAPES)) == line


def test_an_option_outside_of_brackets_must_be_given() -> None:
    shapes = {"fly": grammar.shape("fly --to PLACE | --by WIND [--over HILL | --under BRIDGE]")}
    assert shapes["fly"].needed == (("to", "by"),)
    assert shapes["fly"].rivals == (("to", "by"), ("over", "under"))
    with pytest.raises(BadLine, match="fly: --to or --by is missing; usage: fly"):
        grammar.parse(["fly"], shapes, {})
    with pytest.raises(BadLine, match="take only one of --to and --by"):
        grammar.parse(["fly", "--to", "x", "--by", "y"], shapes, {})
    assert grammar.parse(["fly", "--by", "west"], shapes, {}).text("--by") == "west"


def test_a_usage_string_is_its_own_parser() -> None:
    line = read("create examples/move_to.py:MoveTo as mover on host-1 --json")
    assert line == Line(
        "create", {"--json": True, "FILE": "examples/move_to.py:MoveTo", "NAME": "mover", "HOST": "host-1"}
    )
    assert line.text("NAME") == "mover"
    assert line.flag("--json")
    assert not line.flag("--views")


def test_what_may_be_left_out_is_empty() -> None:
    line = read("create a.py as b")
    assert line.text("HOST") == ""
    assert read("call arm-1.get_info").many("PARAMETER=VALUE") == ()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("create a.py", "'as' is missing"),
        ("create a.py named b", "expected 'as' where 'named' stands"),
        ("create a.py as", "NAME is missing"),
        ("enslave mover.arm", "CHILD is missing"),
        ("delete a b", "'b' is more than it takes"),
        ("ls --colour", "unknown option --colour"),
        ("ls --views=2", "--views takes no value"),
        ("call a.b --within", "--within needs a TIME"),
        ("delete 'a", "no closing quotation"),
    ],
)
def test_a_wrong_line_is_told_what_is_wrong_and_how_it_should_look(text: str, reason: str) -> None:
    with pytest.raises(BadLine) as refusal:
        read(text)
    assert reason in str(refusal.value)


@pytest.mark.parametrize("word", ["frob", "pods", "xyzzy", "sett", "lst", "enslav"])
def test_only_a_near_verb_is_suggested(word: str) -> None:
    with pytest.raises(UnknownVerb) as refusal:
        read(f"{word} arm-1")
    assert refusal.value.near == {"sett": ("set",), "lst": ("ls",), "enslav": ("enslave",)}.get(word, ())


def test_every_example_is_valid_and_is_of_its_own_verb() -> None:
    for action in ACTIONS:
        for example in action.examples:
            assert read(example).verb == action.verb


def test_every_surface_knows_how_to_stop() -> None:
    for where in Where:
        if where is not Where.SCREEN:
            assert "stop" in shapes(where)


def test_no_two_actions_share_a_key_or_a_verb() -> None:
    keys = [action.key for action in ACTIONS if action.key]
    verbs = [action.verb for action in ACTIONS]
    assert len(set(keys)) == len(keys)
    assert len(set(verbs)) == len(verbs)
