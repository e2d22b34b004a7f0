"""Any composition becomes a page that is good, and no text of a person becomes code."""

from __future__ import annotations

import ast
import math
import subprocess
import sys
import types
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from robotree.kinds import Arm
from robotree.testing import Fake, in_turn, rehearse
from robotree.testing.team import unended
from robotree.tui.composing.lines import read_lines, written
from robotree.tui.composing.page import literal, prose, texts
from robotree.tui.composing.steps import (
    OFTEN,
    Checked,
    Comparison,
    ComposedBranch,
    ComposedCall,
    ComposedExpectation,
    ComposedPart,
    ComposedRepeat,
    ComposedStep,
    ComposedTogether,
    ComposedWait,
    Composition,
    Value,
    Variable,
    checked,
    variables,
)
from robotree.tui.composing.writing import KnownRobots, prepared
from robotree.tui.errors import BadComposition
from robotree.vr import Failed
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription

ROBOTS = KnownRobots.of()
KINDS = ROBOTS.kinds
SLOTS = {"arm": "Arm", "rover": "Rover", "friend": "Companion", "head": "Head"}
HOSTILE = [
    '"', "'", '"""', "'''", "\\", "\\\\", "\n", "\r\n", "\u2028", "{x}", "{__import__('os')}", "%s", "$x",
    "$$", "#", "# noqa", '");import os;("', '"""\nimport os\nos.abort()\n"""', "\x00", "\ud7ff",
    "\U0001f9be", "\u202e", "\\N{BULLET}", "\\", "x\\", " ", "\t", "é", "()", "\x1b[31m",
]  # fmt: skip
ANY_TEXTS = st.one_of(
    st.text(max_size=12),
    st.lists(st.sampled_from(HOSTILE), min_size=1, max_size=3).map("".join),
)
TEXTS = ANY_TEXTS.map(lambda text: "".join(each for each in text if each.isprintable()))
NUMBERS = {"x": 0.3, "go": -0.25, "level": 0.1}
"""Parameters that are numbers in metres."""


def value_of(field: FieldSpec) -> st.SearchStrategy[Value]:
    """Return values that a parameter takes."""
    if field.type == "choice":
        return st.sampled_from(field.choices)
    if field.type == "bool":
        return st.booleans()
    if field.type == "str":
        return TEXTS
    low = field.lower if field.lower is not None else -1.0
    high = field.upper if field.upper is not None else 1.0
    if field.type == "int":
        return st.integers(int(low), min(int(high), 3))
    plain: st.SearchStrategy[Value] = st.floats(low, high).map(
        lambda each: min(max(round(each, 4), low), high)
    )
    if field.unit == "m" and low <= -0.5 and high >= 0.5:
        plus = st.sampled_from([0.0, 0.0, 0.05, -0.0125])
        return plain | st.builds(Variable, st.sampled_from(sorted(NUMBERS)), plus)
    return plain


@st.composite
def calls(draw: st.DrawFn, slots: tuple[str, ...]) -> ComposedCall:
    slot = draw(st.sampled_from(slots))
    spec = draw(st.sampled_from(sorted(KINDS[SLOTS[slot]].values(), key=lambda each: each.name)))
    given = [
        (field.name, draw(value_of(field)))
        for field in spec.parameters
        if field.required or draw(st.integers(0, 3)) == 0
    ]
    return ComposedCall(slot, spec.name, tuple(given))


@st.composite
def comparisons(draw: st.DrawFn, slots: tuple[str, ...]) -> Comparison:
    slot = draw(st.sampled_from([each for each in slots if each != "friend"] or ["friend"]))
    if slot == "friend":
        relation = draw(st.sampled_from(["is", "is not"]))
        command, value = draw(
            st.sampled_from([("holding", "nothing"), ("holding", "left"), ("roles", "butler"), ("roles", "")])
        )
        return Comparison("friend", command, "", relation, value)
    parts = {part.name: part for part in KINDS[SLOTS[slot]]["get_info"].result}
    name = draw(st.sampled_from(sorted(parts)))
    if parts[name].type == "bool":
        return Comparison(
            slot, "get_info", name, draw(st.sampled_from(["is", "is not"])), draw(st.booleans())
        )
    relation = draw(st.sampled_from(["above", "below"]))
    return Comparison(slot, "get_info", name, relation, draw(st.integers(-3, 3).map(float)))


@st.composite
def steps(draw: st.DrawFn, slots: tuple[str, ...], depth: int = 1) -> tuple[ComposedStep, ...]:
    return tuple(draw(st.lists(step(slots, depth), min_size=1, max_size=3)))


@st.composite
def step(draw: st.DrawFn, slots: tuple[str, ...], depth: int) -> ComposedStep:  # noqa: PLR0911 # each
    kinds = ["call", "call", "wait", "expect"] + (["part", "repeat", "if"] if depth < 4 else [])
    kinds += ["together"] if depth < 3 else []
    match draw(st.sampled_from(kinds)):
        case "call":
            return draw(calls(slots))
        case "wait":
            return ComposedWait(draw(st.integers(0, 3).map(float)))
        case "expect":
            return ComposedExpectation(
                draw(comparisons(slots)), draw(TEXTS.filter(lambda each: each.strip()))
            )
        case "part":
            return ComposedPart(f"part{draw(st.integers(0, 10**6))}", draw(steps(slots, depth + 1)))
        case "repeat":
            until = draw(st.none() | comparisons(slots))
            return ComposedRepeat(draw(st.integers(1, 3)), draw(steps(slots, depth + 1)), until)
        case "if":
            other = draw(st.just(()) | steps(slots, depth + 1))
            return ComposedBranch(draw(comparisons(slots)), draw(steps(slots, depth + 1)), other)
        case _:
            return ComposedTogether(
                tuple(
                    draw(calls((slot,)))
                    if draw(st.booleans())
                    else ComposedPart(f"part{draw(st.integers(0, 10**6))}", draw(steps((slot,), depth + 2)))
                    for slot in draw(st.permutations(slots))[:2]
                )
            )


@st.composite
def compositions(draw: st.DrawFn) -> Composition:
    """Draw compositions that can be meant."""
    slots = tuple(draw(st.permutations(sorted(SLOTS)))[: draw(st.integers(1, 3))])
    drawn = (*draw(steps(slots)), *(draw(calls((slot,))) for slot in slots))
    used = variables(drawn)
    text = TEXTS.filter(lambda each: bool(each.strip()))
    made = Composition(
        draw(st.sampled_from(["cup", "child", "arm", "a_b_c", "value", "literal", "metres"])),
        tuple((slot, SLOTS[slot]) for slot in slots),
        drawn,
        tuple((name, NUMBERS[name]) for name in used),
        draw(st.sampled_from(["carry_out", "work", "go_on"])),
        draw(text),
        draw(text),
    )
    try:
        checked(made, KINDS)
    except BadComposition as error:
        assume("are called" not in str(error))  # two parts of the same number
        raise
    return made


def modules(good: Checked) -> Mapping[str, Any]:
    """Run the page and its test; returns the names of the test."""
    name, files = good.composition.name, texts(good, KINDS, ROBOTS.shipped, "Drawn by a test.")
    page = types.ModuleType(name)
    exec(compile(files[f"{name}.py"], f"{name}.py", "exec"), vars(page))  # noqa: S102 # what is tested
    sys.modules[name] = page
    test = types.ModuleType(f"test_{name}")
    try:
        exec(compile(files[f"test_{name}.py"], f"test_{name}.py", "exec"), vars(test))  # noqa: S102
    finally:
        del sys.modules[name]
    return vars(test)


@settings(max_examples=30, deadline=None)
@given(made=compositions())
def test_a_composition_is_read_as_it_was_written(made: Composition) -> None:
    good = checked(made, KINDS)
    assert checked(read_lines(written(good.composition)), KINDS) == good


@settings(max_examples=20, deadline=None)
@given(made=compositions())
def test_the_page_of_any_composition_is_taken_and_its_test_passes(made: Composition) -> None:
    good = prepared(made, ROBOTS, "Drawn by a test.").checked
    tests = [value for key, value in modules(good).items() if key.startswith("test_")]
    assert tests
    for test in tests:
        test()
        for team in unended():
            team.close()


def test_ruff_finds_nothing_in_the_files_of_compositions_and_formats_nothing(tmp_path: Path) -> None:
    count = 0

    @settings(max_examples=20, deadline=None, database=None)
    @given(made=compositions())
    def write(made: Composition) -> None:
        nonlocal count
        count += 1
        folder = tmp_path / str(count)
        folder.mkdir()
        for name, text in prepared(made, ROBOTS, "Drawn by a test.").files.items():
            (folder / name).write_text(text)

    write()
    for folder in tmp_path.iterdir():  # in it: what lies there is the person's own
        # a step in a step is an `if` in an `if` (SIM102): the page says it as the steps do
        for words in (["check", "--ignore", "SIM102"], ["format", "--diff"]):
            ruff = [Path(sys.executable).with_name("ruff"), *words, "--isolated", "--no-cache", "."]
            found = subprocess.run(ruff, cwd=folder, capture_output=True, text=True, check=False)
            assert found.returncode == 0, found.stdout
    assert count >= 20


@given(text=ANY_TEXTS)
@example(text='"""')
@example(text="a\\")
def test_a_text_is_a_literal_or_prose_and_nothing_else(text: str) -> None:
    assert ast.literal_eval(literal(text)) == text
    assert "\n" not in literal(text)
    (said,) = ast.parse(f'"""{prose(text)}"""').body
    assert isinstance(said, ast.Expr)
    assert isinstance(said.value, ast.Constant)


@pytest.mark.parametrize(
    "name",
    [
        "", "Cup", "1cup", "cup.py", "cup;import os", "cup\n", "__init__", "class", "match", "a-b", "../cup",
        "x" * 25, "çup", "{x}", "cup'", 'cup"', "os", "robotree",
    ],
)  # fmt: skip
def test_a_name_that_could_be_anything_else_is_refused(name: str) -> None:
    slots, step = (("arm", "Arm"),), ComposedCall("arm", "hold")
    bad = [Composition(name, slots, (step,))]
    if name not in {"os", "robotree"}:
        bad += [
            Composition("cup", ((name, "Arm"),), (ComposedCall(name, "hold"),)),
            Composition("cup", slots, (step,), command=name),
            Composition("cup", slots, (ComposedPart(name, (step,)),)),
            Composition("cup", slots, (ComposedRepeat(Variable(name), (step,)),), ((name, 2),)),
        ]
    for each in bad:
        with pytest.raises(BadComposition):
            checked(each, KINDS)


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_arguments_stay_arguments(text: str) -> None:
    said = ComposedCall("head", "say", (("text", f"a{text}"),))
    made = Composition("cup", (("head", "Head"),), (said,), doc=f"a{text}", does=f"a{text}")
    if not text.isprintable():
        with pytest.raises(BadComposition, match="be printed"):
            prepared(made, ROBOTS, "Drawn by a test.")
        return
    good = prepared(made, ROBOTS, "Drawn by a test.").checked
    for test in (value for key, value in modules(good).items() if key.startswith("test_")):
        test()
        (team,) = unended()
        (call,) = team.commanded
        assert call == ("head", "say", {"text": f"a{text}"})
        team.close()


BAD_NAMES = ["hold(); import os; self.arm.hold", "a b", "a\nb", "a=1", "class", "", "é", "_private", "x" * 65]


@pytest.mark.parametrize("name", BAD_NAMES)
def test_what_a_description_of_somebody_else_calls_things_is_no_code_either(name: str) -> None:
    number = FieldSpec(name=name, type="float")
    evil = {
        name: CommandSpec(name=name),
        "go": CommandSpec(name="go", parameters=(number,)),
        "see": CommandSpec(name="see", effect="read", result=(number,)),
    }
    kinds = {**KINDS, "Evil": evil}
    that = Comparison("one", "see", name, "above", 1.0)
    for step in (
        ComposedCall("one", name),
        ComposedCall("one", "go", ((name, 1.0),)),
        *([ComposedBranch(that, (ComposedCall("arm", "hold"),))] if name else []),
    ):
        made = Composition("cup", (("one", "Evil"), ("arm", "Arm")), (step, ComposedCall("arm", "hold")))
        with pytest.raises(BadComposition, match="cannot be the name of anything"):
            checked(made, kinds)


def test_a_kind_of_somebody_else_is_a_word_and_its_choices_stay_texts() -> None:
    word = FieldSpec(name="what", type="choice", choices=('"]; import os', "b"))
    say = CommandSpec(name="say", parameters=(word,))
    step = ComposedCall("one", "say", (("what", Variable("word")),))
    for kind in ("Evil", '"); import os; ("'):
        evil = RobotDescription(address=Address("robot", "evil", "e"), kinds=(kind,), commands=(say,))
        made = Composition("cup", (("one", kind),), (step,), (("word", '"]; import os'),))
        robots = KnownRobots.of([evil])
        if kind == "Evil":
            tree = ast.parse(prepared(made, robots, "Drawn by a test.").files["cup.py"])
            assert not any(isinstance(node, ast.Import) for node in ast.walk(tree))
        else:
            with pytest.raises(BadComposition, match="is no kind"):
                prepared(made, robots, "Drawn by a test.")


HEAD = "robot cup\nslot arm Arm\nparameter x = 0.3\ndo\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "the first line says `robot NAME`"),
        ("do\n  arm.hold\n", "the first line says `robot NAME`"),
        ("robot cup\nslot arm Leg\ndo\n  arm.hold\n", "nothing is known of a kind 'Leg'"),
        ("robot cup\nslot arm Arm\ndo\n", "no step calls a robot"),
        ("robot cup\nslot arm Arm\ndo\n  arm.fly\n", "Arm has no such command"),
        ("robot cup\nslot arm Arm\ndo\n  leg.hold\n", "there is no slot leg"),
        ("robot cup\nslot arm Arm\ndo\n   arm.hold\n", "line 4: a step is indented by two spaces"),
        ("robot cup\nslot arm Arm\ndo\n      arm.hold\n", "lies deeper than what is above it"),
        ("robot cup\nslot arm Arm\ndo\n  else\n", "`else` stands alone"),
        ("robot cup\nslot arm Arm\ndo\n  part a\n", "there is no step in `part a`"),
        ("robot cup\nslot arm Arm\ndo\n  import os\n", "is no step"),
        ("robot cup\nslot arm Arm\ndo\n  arm.grip action='fly'\n", "action"),
        ("robot cup\nslot arm Arm\ndo\n  arm.grip\n", "arm.grip needs action"),
        ("robot cup\nslot arm Arm\ndo\n  arm.grip action=open how=fast\n", "has no parameter how"),
        ("robot cup\nslot arm Arm\ndo\n  arm.go_to x='2 m' y=0 z=0.2 twist=0\n", "out of range"),
        ("robot cup\nslot arm Arm\ndo\n  arm.go_to x='2 kg' y=0 z=0.2 twist=0\n", "x"),
        ("robot cup\nslot arm Arm\ndo\n  arm.hold 'a\n", "quot"),
        (HEAD + "  arm.hold\n", "no step uses the parameter x"),
        (HEAD + "  arm.go_to x=$x+1 y=0 z=0.2 twist=0\n", "out of range"),
        (HEAD + "  arm.go_to x=$x y=0 z=$x twist=$x\n", "differ in type or unit"),
        (HEAD + "  arm.go_to x=$x+a y=0 z=0.2 twist=0\n", "is a number"),
        (HEAD + "  arm.go_to x=$y y=0 z=0.2 twist=0\n", "there is no parameter y"),
        (HEAD + "  expect arm.get_info.x above 0.1\n", "no step"),
        (HEAD + "  if arm.get_info.x is 0.1\n    arm.hold\n", "compare it with `above` or `below`"),
        (HEAD + "  if arm.hold.x is 0.1\n    arm.hold\n", "it does not only read"),
        (HEAD + "  if arm.get_info.w above 0.1\n    arm.hold\n", "the result has no such value"),
        (HEAD + "  together\n    arm.hold\n    arm.hold\n", "two things at the same time"),
        (HEAD + f"  repeat {OFTEN + 1}\n    arm.hold\n", "out of range"),
        (HEAD + "".join(f"{'  ' * n}part p{n}\n" for n in range(1, 6)) + "            arm.hold\n", "4 deep"),
        (HEAD + "  repeat 3 until arm.get_info.z is 1\n    arm.hold\n", "compare it with `above` or `below`"),
        (HEAD + "  repeat 3 until arm.hold\n    arm.hold\n", "a comparison is SLOT.COMMAND.VALUE"),
        (HEAD + f"  repeat {OFTEN + 1} until arm.get_info.z above 1\n    arm.hold\n", "out of range"),
        (HEAD + "  arm.hold\n" * 300, "more than 200 steps"),
        ("robot " + "x" * 200_000, "more than 100000 characters"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(text: str, told: str) -> None:
    with pytest.raises(BadComposition, match=r"^[^\n]+$") as refused:
        checked(read_lines(text), KINDS)
    assert told in str(refused.value)


UNTIL = """\
robot feel
slot arm Arm
parameter force = 5
do
  repeat 4 until arm.get_info.fz above $force
    arm.hold
"""


def test_a_loop_ends_when_the_reading_is_so_and_fails_when_it_never_is() -> None:
    names = modules(prepared(read_lines(UNTIL), ROBOTS, "Drawn by a test.").checked)
    for forces, times in (([9.0], 1), ([0.0, 4.9, 5.1], 3), ([4.0], 4)):
        never = pytest.raises(Failed, match=r"never so: arm\.get_info\.fz above \$force")
        fake = Fake(Arm, get_info=in_turn(*({"fz": force} for force in forces)))
        with rehearse(names["Feel"], arm=fake) as team:
            with never if times == 4 else nullcontext():
                team.call("work", force=5.0)
            assert len(team.commanded) == times


EXPECTS = """\
robot feel
slot arm Arm
do
  expect arm.get_info.fz {relation} 5 else 'it is not so'
  arm.hold
"""


@pytest.mark.parametrize("relation", ["above", "below"])
def test_a_reading_that_is_not_a_number_fulfils_no_expectation(relation: str) -> None:
    composition = read_lines(EXPECTS.format(relation=relation))
    names = modules(prepared(composition, ROBOTS, "Drawn by a test.").checked)
    fake = Fake(Arm, get_info={"fz": math.nan})
    with rehearse(names["Feel"], arm=fake) as team:
        with pytest.raises(Failed, match="it is not so"):
            team.call("work")
        assert not team.commanded


def test_one_call_takes_no_more_steps_than_a_test_can_play() -> None:
    inner = ComposedRepeat(OFTEN, (ComposedCall("arm", "hold"),))
    made = Composition("cup", (("arm", "Arm"),), (ComposedRepeat(OFTEN, (inner,)),))
    with pytest.raises(BadComposition, match="repeat less"):
        prepared(made, ROBOTS, "Drawn by a test.")
