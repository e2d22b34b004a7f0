"""Agents read as text: units, ranges and results as people write them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.line.manual import overview, page, shell
from robotree.tui.screen.jog import bounds
from robotree.tui.seen import wording
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
