"""What callers see of a command, what it takes as arguments, and what it may return."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr import BadArgument, Child, Range, Robot, Unit, VirtualRobot, command
from robotree.vr.author.command import commands_of
from robotree.vr.author.signature import signature_of
from robotree.vr.author.virtual_robot import exposures_of, slots_of
from robotree.vr.base.arguments import check_argument, check_arguments, expected
from robotree.vr.base.description import CommandSpec, FieldSpec
from robotree.vr.base.errors import CommandFailed
from tests.vr.core.crew import Where

Metres = Annotated[float, Unit("m")]


class Pose(msgspec.Struct):
    x: Annotated[float, Unit("m"), "ahead"]
    twist: Annotated[float, Unit("rad")]
    busy: bool


@dataclasses.dataclass
class Grip:
    width: Metres


class Arm(Robot):
    """An arm.

    It grips.
    """

    @command(effect="repeat")
    def go_to(
        self,
        x: Annotated[Metres, Range(-0.7, 0.7), "ahead of the base"],
        *,
        speed: Annotated[float | None, Unit("m/s")] = None,
        elbow: Literal["up", "down"] = "up",
    ) -> None:
        """Go to a point.

        In a straight line.
        """

    @command(effect="read")
    def get_info(self) -> Pose:
        """Tell where it is."""
        return Pose(0, 0, busy=False)

    @command
    def grip(self, width: Metres | None = None, n: int = 1) -> Grip:
        return Grip(width or float(n))

    @command
    def count(self) -> int:
        return 1

    @command
    def anything(self) -> Any:
        return None

    def not_a_command(self) -> None: ...


def test_what_callers_see_of_a_method() -> None:
    go_to = commands_of(Arm)["go_to"].spec
    assert go_to.effect == "repeat"
    assert go_to.doc == "Go to a point.\n\nIn a straight line."
    assert go_to.parameters == (
        FieldSpec(name="x", type="float", unit="m", lower=-0.7, upper=0.7, doc="ahead of the base"),
        FieldSpec(name="speed", type="float", unit="m/s", nullable=True, required=False),
        FieldSpec(name="elbow", type="choice", choices=("up", "down"), required=False, default="up"),
    )
    assert go_to.result == ()


def test_results_have_typed_parts() -> None:
    specs = {name: found.spec for name, found in commands_of(Arm).items()}
    assert list(specs) == ["go_to", "get_info", "grip", "count", "anything"]
    assert specs["get_info"].result == (
        FieldSpec(name="x", type="float", unit="m", doc="ahead"),
        FieldSpec(name="twist", type="float", unit="rad"),
        FieldSpec(name="busy", type="bool"),
    )
    assert specs["grip"].result == (FieldSpec(name="width", type="float", unit="m"),)
    assert specs["count"].result == (FieldSpec(name="", type="int"),)
    assert specs["anything"].result == ()


def test_a_command_stays_an_ordinary_method() -> None:
    assert Arm("arm-1").grip(0.05).width == 0.05


def test_kinds_are_the_classes_most_special_first() -> None:
    class FastArm(Arm): ...

    assert FastArm.kinds() == ("FastArm", "Arm", "Robot")


def test_a_subclass_inherits_overrides_and_removes_commands() -> None:
    class Lame(Arm):
        grip = None  # type: ignore[assignment]

        @command(effect="read")
        def count(self) -> int:
            return 2

    assert list(commands_of(Lame)) == ["go_to", "get_info", "count", "anything"]
    assert commands_of(Lame)["count"].spec.effect == "read"
    assert commands_of(Arm)["count"].spec.effect == "once"


def test_slots_and_exposures_are_declared_in_the_class() -> None:
    class Square(VirtualRobot):
        rover = Child("Rover", "what drives")
        move = rover.exposed()
        drive = rover.exposed("move")

    class Cube(Square):
        lift = Child("Lift")
        drive = None  # type: ignore[assignment]

    assert {name: child.kind for name, child in slots_of(Cube).items()} == {"rover": "Rover", "lift": "Lift"}
    assert {name: exposed.command for name, exposed in exposures_of(Cube).items()} == {"move": "move"}
    cube = Cube("cube")
    assert not cube.rover
    assert str(cube.rover) == "nobody in rover"
    assert [spec.doc for spec in cube.child_slots.specs()] == ["what drives", ""]


@dataclass
class Tree:
    below: list[Tree]


class Side(Enum):
    LEFT = 1


def declare(function: Any) -> type[Robot]:
    function.__qualname__ = f"Odd.{function.__name__}"
    return type("Odd", (Robot,), {function.__name__: command(function)})


def test_an_author_is_told_what_is_wrong_with_a_command() -> None:
    """What a page cannot easily show; the rest is in `authoring/test_mistakes.py`."""

    def recursive(self: Any, x: Tree) -> None: ...
    def picture(self: Any, x: bytes) -> None: ...
    def starry(self: Any, *x: float) -> None: ...
    def ranged(self: Any, x: Annotated[str, Range(0, 1)]) -> None: ...
    def numbers_as_keys(self: Any, x: dict[int, float]) -> None: ...
    def unsaid(self: Any, x: dict) -> None: ...  # type: ignore[type-arg]
    def unknown(self: Any, x: Metre) -> None: ...  # type: ignore[name-defined]  # noqa: F821
    def _hidden(self: Any) -> None: ...

    sentences = {
        recursive: "Odd.recursive: parameter 'x': its 'below': a value of it contains itself: a Tree cannot "
        "lie in a Tree",
        picture: "Odd.picture: parameter 'x' cannot be bytes: only a result can",
        starry: "Odd.starry: parameter 'x': a command takes named parameters only",
        ranged: "Odd.ranged: parameter 'x': only numbers have a unit or a range",
        numbers_as_keys: "Odd.numbers_as_keys: parameter 'x' cannot be dict[int, float]: the keys are texts: "
        "write dict[str, …]",
        unsaid: "Odd.unsaid: parameter 'x' does not say what is in it: write for example dict[str, float]",
        unknown: "Odd.unknown: name 'Metre' is not defined; define it in the file, outside of functions",
        _hidden: "Odd._hidden: a command cannot have this name; every robot uses it itself",
    }
    for function, sentence in sentences.items():
        with pytest.raises(TypeError) as refused:
            commands_of(declare(function))
        assert str(refused.value) == sentence


def test_the_inside_of_a_command_works_only_there() -> None:
    with pytest.raises(RuntimeError, match="only inside a running command"):
        Arm("arm-1").sleep(1)


# -- arguments -------------------------------------------------------------------------------------


REACH = FieldSpec(name="x", type="float", unit="m", lower=-0.7, upper=0.7)
TURN = FieldSpec(name="twist", type="float", unit="rad", required=False, default=0.0)
COUNT = FieldSpec(name="n", type="int", lower=0, required=False, default=1)
HOW = FieldSpec(name="action", type="choice", choices=("open", "close"), required=False, default="open")
HARD = FieldSpec(name="hard", type="bool", required=False, default=False)
NOTE = FieldSpec(name="note", type="str", required=False, default="")
SPEED = FieldSpec(name="speed", type="float", unit="m/s", required=False)
GO = CommandSpec(name="go_to", parameters=(REACH, TURN, COUNT, HOW, HARD, NOTE, SPEED))


@pytest.mark.parametrize(
    ("given_", "meant"),
    [
        ({"x": 0.5}, {"x": 0.5}),
        ({"x": "0.5"}, {"x": 0.5}),
        ({"x": "50 cm"}, {"x": 0.5}),
        ({"x": "50cm"}, {"x": 0.5}),
        ({"x": ".5 m"}, {"x": 0.5}),
        ({"x": "-2e-1"}, {"x": -0.2}),
        ({"x": "10 in"}, {"x": 0.254}),
        ({"x": 0, "twist": "90 deg"}, {"x": 0.0, "twist": math.pi / 2}),
        ({"x": 0, "twist": "90°"}, {"x": 0.0, "twist": math.pi / 2}),
        ({"x": 0, "speed": "36 km/h"}, {"x": 0.0, "speed": 10.0}),
        ({"x": 0, "speed": None}, {"x": 0.0, "speed": None}),
        ({"x": 0, "n": "3"}, {"x": 0.0, "n": 3}),
        ({"x": 0, "n": 3.0}, {"x": 0.0, "n": 3}),
        ({"x": 0, "n": 10**17 + 1}, {"x": 0.0, "n": 10**17 + 1}),
        ({"x": 0, "hard": "yes"}, {"x": 0.0, "hard": True}),
        ({"x": 0, "hard": False}, {"x": 0.0, "hard": False}),
        ({"x": 0, "action": "close"}, {"x": 0.0, "action": "close"}),
        ({"x": 0, "note": "3 m"}, {"x": 0.0, "note": "3 m"}),
    ],
)
def test_what_a_person_writes_is_understood(given_: dict[str, object], meant: dict[str, object]) -> None:
    assert check_arguments(GO, given_) == pytest.approx(meant)


@pytest.mark.parametrize(
    ("given_", "sentence"),
    [
        ({}, "arm-1.go_to: x: is missing; give a number in m from -0.7 to 0.7"),
        (
            {"y": 1},
            "arm-1.go_to: y: there is no such parameter; it takes x, twist, n, action, hard, note, speed",
        ),
        ({"x": 0.9}, "arm-1.go_to: x: 0.9 m is out of range; give a number in m from -0.7 to 0.7"),
        ({"x": "90 cm"}, "arm-1.go_to: x: 90 cm is out of range; give a number in m from -0.7 to 0.7"),
        ({"x": "90 deg"}, "arm-1.go_to: x: deg cannot be turned into m; give it in m"),
        ({"x": "1 fathomless"}, "arm-1.go_to: x: the unit 'fathomless' is not known; give it in m"),
        ({"x": "9**9**9"}, "arm-1.go_to: x: '**9**9' cannot be read as a unit; give it in m"),
        ({"x": "far"}, "arm-1.go_to: x: 'far' is not a number in m"),
        ({"x": "1" * 1000}, f"arm-1.go_to: x: '{'1' * 78}… is not a number in m"),
        ({"x": math.nan}, "arm-1.go_to: x: nan is not a finite number; give a number in m from -0.7 to 0.7"),
        (
            {"x": -math.inf},
            "arm-1.go_to: x: -inf is not a finite number; give a number in m from -0.7 to 0.7",
        ),
        ({"x": "1e999"}, "arm-1.go_to: x: 1e999 is not a finite number; give a number in m from -0.7 to 0.7"),
        ({"x": True}, "arm-1.go_to: x: True is not a number in m from -0.7 to 0.7"),
        ({"x": [1]}, "arm-1.go_to: x: [1] is not a number in m from -0.7 to 0.7"),
        ({"x": None}, "arm-1.go_to: x: None is not a number in m from -0.7 to 0.7"),
        ({"x": 0, "n": -1}, "arm-1.go_to: n: -1 is out of range; give a whole number of 0 or more"),
        ({"x": 0, "n": 1.5}, "arm-1.go_to: n: 1.5 is not a whole number of 0 or more"),
        ({"x": 0, "n": "3 m"}, "arm-1.go_to: n: '3 m' has a unit; it takes a plain number"),
        ({"x": 0, "action": "shut"}, "arm-1.go_to: action: 'shut' is not one of open, close"),
        ({"x": 0, "hard": 2}, "arm-1.go_to: hard: 2 is not true or false"),
        ({"x": 0, "note": 3}, "arm-1.go_to: note: 3 is not text"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(given_: dict[str, object], sentence: str) -> None:
    with pytest.raises(BadArgument) as refused:
        check_arguments(GO, given_, robot="arm-1")
    assert str(refused.value) == sentence


@given(st.one_of(st.text(), st.integers(), st.floats(), st.none(), st.binary(), st.lists(st.integers())))
def test_whatever_comes_is_a_number_in_range_or_refused(value: object) -> None:
    number = 0.0
    with contextlib.suppress(BadArgument):
        number = check_argument(REACH, value, command="go_to")
    assert isinstance(number, float)
    assert -0.7 <= number <= 0.7


@given(st.floats(-0.7, 0.7))
def test_units_only_change_the_writing(metres: float) -> None:
    millimetres = check_argument(REACH, f"{metres * 1000!r} mm", command="go_to")
    assert millimetres == pytest.approx(metres, abs=1e-12)


def test_a_form_can_say_what_a_parameter_takes() -> None:
    assert [expected(field) for field in GO.parameters] == [
        "a number in m from -0.7 to 0.7",
        "a number in rad",
        "a whole number of 0 or more",
        "one of open, close",
        "true or false",
        "text",
        "a number in m/s",
    ]


# -- what a command returns is what its signature promises -----------------------------------------


METRES, SIDE = Annotated[float, Unit("m"), "how far"], Literal["left", "right"]


class Liar(Robot):
    """Fails as the test chooses."""

    truth: Any = None

    @command
    def fails(self) -> None:
        raise self.truth

    @command
    def divides(self) -> float:
        return (1.0 + 2.0) / (3.0 * self.truth)


def returned(promise: Any, truth: Any) -> Any:
    """Return what callers get of a command that promises something and returns the truth."""

    def give(self: Robot) -> Any: ...

    give.__annotations__ = {"return": promise}
    return signature_of(give, "once").plain_result(truth, robot="liar", name="give")


@pytest.mark.parametrize(
    ("promise", "truth", "sentence"),
    [
        (int, "abc", "it promises int but returned 'abc': Expected `int`, got `str`"),
        (int, 1.5, "it promises int but returned 1.5"),
        (int, True, "it promises int but returned True"),
        (int, None, "it promises int but returned None"),
        (METRES, "1 m", "it promises float but returned '1 m'"),
        (float | None, [], "it promises float | None but returned []"),
        (None, 0, "it promises nothing but returned 0"),
        (SIDE, "up", "it promises Literal['left', 'right'] but returned 'up'"),
        (Where, {"x": "here", "moves": 1}, "Expected `float`, got `str` - at `$.x`"),
        (Where, 1, "Where but returned 1"),
    ],
)
def test_a_result_is_what_its_signature_promises_or_a_failure(
    promise: Any, truth: Any, sentence: str
) -> None:
    with pytest.raises(CommandFailed) as refused:
        returned(promise, truth)
    assert str(refused.value).startswith("liar.give failed: it promises ")
    assert sentence in str(refused.value)


@pytest.mark.parametrize(
    ("promise", "truth", "plain"),
    [
        (int, 7, 7),
        (METRES, 1, 1),
        (float | None, None, None),
        (SIDE, "left", "left"),
        (Where, Where(1.0, 2), {"x": 1.0, "moves": 2}),
        (Where, {"x": 1.0, "moves": 2}, {"x": 1.0, "moves": 2}),
        (Any, [1, "a"], [1, "a"]),  # an author may leave it open
    ],
)
def test_a_result_that_keeps_its_promise_travels(promise: Any, truth: Any, plain: Any) -> None:
    assert returned(promise, truth) == plain


class Unspeakable(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no words")


async def test_an_error_that_cannot_be_written_ends_its_command_all_the_same(realm: Any) -> None:
    liar = await realm.start(Liar("liar"))
    liar.robot.truth = Unspeakable()
    with pytest.raises(CommandFailed, match=r"liar.fails failed: Unspeakable \("):
        await realm.client(liar).call("fails", {})
    assert not liar.description().busy


async def test_the_trace_of_an_error_is_written_without_parsing_python(
    realm: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Threads of commands must not disturb a parser elsewhere: CPython 3.11.7 confuses the two."""
    parsed: list[object] = []
    monkeypatch.setattr("ast.parse", lambda *given, **_: parsed.append(given))
    liar = await realm.start(Liar("liar"))
    liar.robot.truth = 0.0
    with pytest.raises(CommandFailed, match=r"liar.divides failed: ZeroDivisionError"):
        await realm.client(liar).call("divides", {})
    assert "return (1.0 + 2.0) / (3.0 * self.truth)" in caplog.text
    assert not parsed
