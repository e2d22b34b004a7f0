"""One grammar everywhere: what is written is read back, or refused in a sentence."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.tui.errors import BadLine, SupervisorError, UnknownVerb, ValueRefused
from robotree.tui.line import grammar, manual, values
from robotree.tui.line.action import Where
from robotree.tui.line.actions import ACTIONS, shapes
from robotree.tui.line.grammar import Blank, Group, Line, Part, Value, Word
from robotree.tui.line.surface import Surface
from robotree.vr.base.errors import VrError

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


# -- whatever is typed is understood, or refused in a sentence -------------------------------------

WORDS = [word for action in manual.shell().actions for word in action.usage.replace("[", " ").split()]
SURFACES = [manual.shell(), *(Surface(where, readonly) for where in Where for readonly in (False, True))]

words = st.lists(
    st.one_of(
        st.sampled_from(WORDS),
        st.sampled_from(
            ["a.b", "..", "x=1", "x=", "--", "--json", "--realm", "../x", "5s", "-1s", "640x0", ""]
        ),
        st.text(max_size=8),
    ),
    max_size=7,
)


@settings(max_examples=400)
@given(surface=st.sampled_from(SURFACES), given_words=words)
def test_a_line_is_understood_or_refused_in_a_sentence(surface: Surface, given_words: list[str]) -> None:
    with contextlib.suppress(SupervisorError, VrError):
        line = surface.parse(given_words)
        assert line.verb in surface.shapes


@pytest.mark.parametrize("made", ["host hall:h", "directory hall:d", "space serve hall:jobs"])
def test_what_is_made_here_is_called_without_a_site(made: str) -> None:
    with pytest.raises(VrError, match="hall:"):
        manual.shell().parse(made.split())


# -- small values are read, or refused in one sentence ---------------------------------------------


@pytest.mark.parametrize(
    ("text", "seconds"), [("5", 5), ("5s", 5), ("1.5 s", 1.5), ("500ms", 0.5), ("2min", 120), ("1h", 3600)]
)
def test_a_duration_is_read_in_seconds(text: str, seconds: float) -> None:
    assert values.duration(text) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "soon", "-1s", "5 parsecs", "nan", "1e3"])
def test_what_is_no_duration_is_refused(text: str) -> None:
    with pytest.raises(ValueRefused, match="is no duration"):
        values.duration(text)


@given(number=st.floats(allow_nan=False, allow_infinity=False))
def test_a_finite_number_is_read_back_exactly(number: float) -> None:
    assert values.scalar(repr(number)) == number


@given(number=st.integers(-(10**15), 10**15))
def test_an_integer_stays_an_integer(number: int) -> None:
    found = values.scalar(str(number))
    assert found == number
    assert isinstance(found, int)


@pytest.mark.parametrize("text", ["nan", "inf", "-Infinity", "1e999", "10 cm", "1_000", "", "None"])
def test_what_is_no_finite_number_stays_text(text: str) -> None:
    assert values.scalar(text) == text


def test_truth_is_written_in_words() -> None:
    assert values.scalar("true") is True
    assert values.scalar("false") is False


def test_an_assignment_needs_a_name() -> None:
    assert values.assignment("x=10 cm") == ("x", "10 cm")
    assert values.assignment("x=0.4") == ("x", "0.4"), "the robot knows the type"
    assert values.assignment("label=a=b") == ("label", "a=b")
    for text in ("x", "=3", "a b=3"):
        with pytest.raises(ValueRefused, match="name=value"):
            values.assignment(text)


def test_a_dotted_path_has_two_ends() -> None:
    assert values.dotted("mover.arm", "PARENT.SLOT") == ("mover", "arm")
    for text in ("mover", ".arm", "mover."):
        with pytest.raises(ValueRefused, match=r"PARENT\.SLOT"):
            values.dotted(text, "PARENT.SLOT")


def test_a_source_may_name_its_class() -> None:
    assert values.source("a/b.py:Painter") == ("a/b.py", "Painter")
    assert values.source("a/b.py") == ("a/b.py", "")
    assert values.source("C:/robots/b.py") == ("C:/robots/b.py", "")


def test_a_size_has_an_area() -> None:
    assert values.size("640x360") == (640, 360)
    assert values.size("3840x2160") == (3840, 2160), "what can be rendered is for the view to know"
    assert values.size("1x1") == (1, 1)
    for text in ("640", "x", "640x360x2", "0x5", "5x00", "-1x5", "9999999x1"):
        with pytest.raises(ValueRefused, match="no picture size"):
            values.size(text)
