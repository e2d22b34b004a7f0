"""A form is made from a command's types, and what it lets through the robot takes."""

from __future__ import annotations

import math
import shlex

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.screen import entry
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import CommandSpec, FieldSpec

GO_TO = CommandSpec(
    name="go_to",
    parameters=(
        FieldSpec(name="x", type="float", unit="m", lower=0.2, upper=0.7),
        FieldSpec(name="speed", type="float", unit="m/s", lower=0.01, upper=0.5, required=False, default=0.1),
        FieldSpec(name="count", type="int", required=False),
        FieldSpec(name="smooth", type="bool"),
        FieldSpec(name="action", type="choice", choices=("open", "close")),
        FieldSpec(name="label", type="str", required=False),
    ),
)
GOOD = {"x": "0.4", "speed": "0.1", "count": "", "smooth": "yes", "action": "open", "label": ""}


def test_a_good_form_becomes_arguments_without_what_was_left_empty() -> None:
    read = entry.read(GO_TO, GOOD)
    assert read.complaints == {}
    assert read.arguments == {"x": 0.4, "speed": 0.1, "smooth": True, "action": "open"}


def test_another_unit_is_converted_at_the_field() -> None:
    assert entry.read(GO_TO, {**GOOD, "x": "40 cm"}).arguments["x"] == 0.4


def test_each_wrong_field_is_explained_beside_itself() -> None:
    read = entry.read(
        GO_TO, {"x": "nan", "speed": "2", "count": "1.5", "smooth": "perhaps", "action": "", "label": ""}
    )
    assert set(read.complaints) == {"x", "speed", "count", "smooth", "action"}
    assert "not a number in m" in read.complaints["x"]
    assert "out of range" in read.complaints["speed"]
    assert "whole number" in read.complaints["count"]
    assert "true or false" in read.complaints["smooth"]
    assert "open, close" in read.complaints["action"]


def test_a_form_opens_with_defaults_and_present_values_so_that_sending_it_moves_nothing() -> None:
    readings = {"x": 0.43217777, "speed": 0.3}
    texts = {field.name: entry.first_text(field, readings) for field in GO_TO.parameters}
    assert texts == {"x": "0.4322", "speed": "0.1", "count": "", "smooth": "no", "action": "", "label": ""}


def test_beside_a_field_stand_unit_range_default_and_present_value() -> None:
    x, speed, count, *_ = GO_TO.parameters
    assert entry.hints(x, {"x": 0.432}) == ["0.2 … 0.7 m", "now 0.432"]
    assert entry.hints(speed, {}) == ["0.01 … 0.5 m/s", "default 0.1"]
    assert entry.hints(count, {}) == ["may stay empty"]


def test_a_hint_shows_as_many_parts_as_fit_each_whole() -> None:
    parts = ["0.2 … 0.7 m", "default 0.3", "now 0.432"]
    assert entry.fitting(parts, 37) == "0.2 … 0.7 m · default 0.3 · now 0.432"
    assert entry.fitting(parts, 36) == "0.2 … 0.7 m · default 0.3"
    assert entry.fitting(parts, 24) == entry.fitting(parts, 5) == "0.2 … 0.7 m"
    assert not entry.fitting([], 5)


TURN = CommandSpec(
    name="turn",
    parameters=(
        FieldSpec(name="twist", type="float", unit="rad", lower=-math.pi, upper=math.pi),
        FieldSpec(
            name="rate", type="float", unit="rad/s", lower=0.0, required=False, default=math.radians(30)
        ),
    ),
)


def test_angles_are_in_degrees_as_the_readings_beside_them() -> None:
    twist, rate = TURN.parameters
    readings = {"twist": math.radians(12.345)}
    assert entry.first_text(twist, readings) == "12.35"
    assert entry.first_text(rate, readings) == "30.0"
    assert entry.hints(twist, readings) == ["-180 … 180 °", "now 12.35"]
    assert entry.hints(rate, {}) == ["≥ 0 °/s", "default 30"]
    read = entry.read(TURN, {"twist": "45", "rate": "90"})
    assert read.arguments == {"twist": math.radians(45), "rate": math.radians(90)}
    assert entry.read(TURN, {"twist": "1 rad", "rate": ""}).arguments == {"twist": pytest.approx(1)}
    assert "in ° from -180 to 180" in entry.complaint(twist, "200")


def test_a_full_turn_in_degrees_is_not_out_of_the_robots_range() -> None:
    for text in ("180", "-180"):
        arguments = entry.read(TURN, {"twist": text, "rate": ""}).arguments
        assert check_arguments(TURN, arguments)["twist"] == pytest.approx(math.radians(float(text)))


def test_the_line_for_a_shell_means_the_same_angle() -> None:
    line = entry.command_line("arm-1", TURN, {"twist": "45", "rate": "0.5 rad/s"})
    assert line == "robotree call arm-1.turn twist=45deg 'rate=0.5 rad/s'"
    words = dict(word.split("=") for word in shlex.split(line)[3:])
    assert check_arguments(TURN, words)["twist"] == pytest.approx(math.radians(45))
    plain = entry.command_line("arm-1", TURN, {"twist": "", "rate": "90"})
    assert check_arguments(TURN, {"twist": 0, **dict([shlex.split(plain)[3].split("=")])})[
        "rate"
    ] == pytest.approx(math.radians(90))


@given(
    texts=st.fixed_dictionaries(
        {field.name: st.text(max_size=12) | st.floats().map(str) for field in GO_TO.parameters}
    )
)
def test_what_the_form_lets_through_the_robot_takes(texts: dict[str, str]) -> None:
    read = entry.read(GO_TO, texts)
    if not read.complaints:
        assert check_arguments(GO_TO, read.arguments) == read.arguments


POSE = FieldSpec(
    name="",
    type="record",
    items=(
        FieldSpec(name="x", type="float", unit="m"),
        FieldSpec(name="twist", type="float", unit="rad", lower=-math.pi, upper=math.pi, required=False),
    ),
)
FOLLOW = CommandSpec(
    name="follow",
    parameters=(
        FieldSpec(name="path", type="list", items=(POSE,)),
        FieldSpec(
            name="cone",
            type="tuple",
            items=(FieldSpec(name="", type="float", unit="rad"),) * 2,
            required=False,
            default=[0.0, math.radians(30)],
        ),
    ),
)


def test_an_angle_inside_a_list_or_record_is_in_degrees_too() -> None:
    path, cone = FOLLOW.parameters
    assert entry.first_text(cone, {}) == "[0.0, 30.0]"
    assert entry.hints(path, {}) == ["[{x: m, twist: °}, …]"]
    assert entry.hints(cone, {}) == ["(°, °)", "default 0, 30"]
    read = entry.read(FOLLOW, {"path": "[{x: 20 cm, twist: 90}, {x: 1}]", "cone": "10, 0.5 rad"})
    assert read.arguments == {
        "path": [{"x": 0.2, "twist": pytest.approx(math.pi / 2)}, {"x": 1.0}],
        "cone": [pytest.approx(math.radians(10)), pytest.approx(0.5)],
    }
    assert entry.complaint(path, "[{x: 1, twist: 200}]").startswith("[0].twist: 200 is out of range")
    assert "in ° from -180 to 180" in entry.complaint(path, "[{x: 1, twist: 200}]")


def test_the_line_for_a_shell_names_degrees_inside_a_list_or_record() -> None:
    line = entry.command_line("arm-1", FOLLOW, {"path": "{x: 1, twist: 90}, {x: 2}", "cone": "10, 0.5 rad"})
    words = dict(word.split("=", 1) for word in shlex.split(line)[3:])
    assert words == {"path": "[{x: 1, twist: 90deg}, {x: 2}]", "cone": "[10deg, 0.5 rad]"}
    assert check_arguments(FOLLOW, words)["path"][0]["twist"] == pytest.approx(math.pi / 2)
    assert "path=nonsense" in entry.command_line("arm-1", FOLLOW, {"path": "nonsense"})


def test_a_form_that_is_sent_as_it_opened_sends_the_default_of_an_angle() -> None:
    (cone,) = FOLLOW.parameters[1:]
    spec = CommandSpec(name="open", parameters=(cone,))
    assert entry.read(spec, {"cone": entry.first_text(cone, {})}).arguments["cone"] == pytest.approx(
        cone.default
    )
