from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr import BadArgument
from robotree.vr.base.arguments import check_argument, check_arguments, expected
from robotree.vr.base.description import CommandSpec, FieldSpec

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
