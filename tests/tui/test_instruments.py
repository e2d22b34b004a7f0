"""Readings in groups, and long rows of tables: each figure and word stands where it is looked for."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Span, Text

from robotree.tui.screen.hanging import TIE, broken, hanging
from robotree.tui.seen import instruments
from robotree.tui.seen.instruments import BARS, HALF, bar, bars, figure, groups
from robotree.vr.base.readable import DECIMALS, OTHER

UNITS = {
    **dict.fromkeys(("x", "y", "z", "width"), "m"),
    **dict.fromkeys(("fx", "fy", "fz", "grip_force"), "N"),
    **dict.fromkeys(("twist", "j1", "j2"), "rad"),
    "age": "s",
}  # fmt: skip
ARM = {"x": 0.281, "y": -0.0201, "z": 0.4756, "twist": math.pi / 2, "fx": 3.0, "fy": 4.0, "fz": 0.0}


def lines(readings: dict[str, float], *, old: bool = False) -> list[str]:
    found = groups(readings, UNITS, old=old)
    return [
        " ".join([group.label, *(f"{one.name} {one.text} {one.unit}".strip() for one in group.figures)])
        for group in found
    ]


def test_readings_are_grouped_as_they_are_read() -> None:
    assert lines({**ARM, "width": 0.08, "grip_force": 0.1, "j1": 0.25, "j2": -0.5, "age": 0.2}) == [
        "pose x 0.281 y -0.020 z 0.476 m twist 90.0 °",
        "force 5.0 N fx 3.0 fy 4.0 fz 0.0 N",
        "grip 80 mm holds nothing",
        "joints 14.3 -28.6 °",
    ]


@pytest.mark.parametrize(
    ("age", "old", "shown"), [(0.2, False, False), (3.0, False, True), (0.2, True, True)]
)
def test_an_age_is_shown_only_when_it_matters(age: float, old: bool, shown: bool) -> None:  # noqa: FBT001 # cases
    assert ("age" in "".join(lines({"x": 1.0, "age": age}, old=old))) == shown


def test_what_is_counted_has_neither_decimals_nor_a_unit() -> None:
    assert figure(3.0, "count") == ("3", "")


@given(value=st.floats(-1e4, 1e4), unit=st.sampled_from(["m", "rad", "N", "s", "", "count", "furlong"]))
def test_the_decimals_of_a_unit_never_change(value: float, unit: str) -> None:
    text, told = figure(value, unit)
    assert len(text.partition(".")[2]) == DECIMALS.get(unit, OTHER)
    assert told != "rad", "there is one unit for angles"
    assert text.strip("-0.") or not text.startswith("-"), "nothing is minus zero"


@given(
    readings=st.dictionaries(
        st.text(max_size=6), st.floats(allow_nan=False, allow_infinity=False), max_size=12
    )
)
def test_every_reading_but_a_young_age_is_shown(readings: dict[str, float]) -> None:
    shown = sum(len(group.figures) for group in groups(readings, UNITS, old=True))
    extra = instruments.size(readings) is not None
    assert shown == len(readings) + extra


@given(values=st.lists(st.floats(0, 100)), cells=st.integers(1, 20))
def test_a_line_of_bars_has_its_width_and_the_newest_on_the_right(values: list[float], cells: int) -> None:
    drawn = bars(values[-cells:], 0.0, 35.0).rjust(cells)
    assert len(drawn) == cells
    if values:
        assert drawn[-1] == BARS[min(round(7 * values[-1] / 35.0), 7)]


@given(value=st.floats(-1e9, 1e9))
def test_a_bar_grows_from_the_middle_and_never_out_of_its_place(value: float) -> None:
    left, right = bar(value, 35.0)
    assert len(left) == len(right) == HALF
    assert not (left.strip() and right.strip())
    if abs(value) >= 35:
        assert (right if value > 0 else left) == "█" * HALF


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_draws_no_bar(value: float) -> None:
    assert "".join(bar(value, 35.0)).strip() == bars([value], 0.0, 35.0).strip() == ""


def test_a_well_known_reading_without_a_unit_is_in_si_units() -> None:
    shown = groups({"x": 0.1, "twist": math.pi, "fx": 3.0, "tx": -0.001, "j1": 0.25}, {})
    texts = [[(one.text, one.unit) for one in group.figures] for group in shown]
    assert texts == [
        [("0.100", "m"), ("180.0", "°")],
        [("3.0", "N"), ("3.0", "N")],
        [("0.00", "N m")],
        [("14.3", "°")],
    ]


def test_joints_share_a_line_until_they_are_unfolded() -> None:
    joints = {"j1": 0.25, "j2": -0.5, "j10": 0.0}
    assert [group.label for group in groups(joints, UNITS)] == ["joints"]
    assert [group.label for group in groups(joints, UNITS, folded=False)] == ["j1", "j2", "j10"]


def test_a_figure_stays_with_its_name_and_its_unit_where_a_line_ends() -> None:
    words = Text.assemble(f"x{TIE}0.196 z{TIE}0.496{TIE}m  ", (f"twist{TIE}0.0{TIE}°", "bold"))
    lines = broken(words, 24, Console())
    assert [line.plain for line in lines] == ["x 0.196 z 0.496 m", "twist 0.0 °"]
    assert lines[1].spans == [Span(0, 11, "bold")]
    assert [line.plain for line in broken(words, 40, Console())] == ["x 0.196 z 0.496 m  twist 0.0 °"]
    sentence = Text("the robot would go 0.35 m, 0.9 s, and 3 robots would")
    assert [line.plain for line in broken(sentence, 24, Console())] == [
        "the robot would go",
        "0.35 m, 0.9 s, and 3",
        "robots would",
    ]


def test_a_gap_of_nothing_has_no_sign() -> None:
    assert lines({"width": -0.0003}) == ["grip 0 mm"]


# -- a long row of a table goes on below its last column -------------------------------------------

CONSOLE = Console(width=200)


def hung(text: Text | str, width: int) -> list[str]:
    return hanging(Text(text) if isinstance(text, str) else text, width, CONSOLE).plain.split("\n")


def test_the_last_column_goes_on_below_itself() -> None:
    table = "arm-1  free  An arm that goes to points, gripper down.\n  R    Resume.\n\nend"
    assert hung(table, 40) == [
        "arm-1  free  An arm that goes to points,",
        "             gripper down.",
        "  R    Resume.",
        "",
        "end",
    ]


def test_a_column_that_would_be_too_narrow_begins_on_the_left_again() -> None:
    line = f"{'x' * 30}  {'word ' * 6}".rstrip()
    assert hung(line, 40) == [line], "it is left to be hung by the widget"


def test_styles_stay_with_their_words() -> None:
    text = Text.assemble(("  key  ", "bold"), ("one two three four five six seven", "red"))
    made = hanging(text, 32, CONSOLE)
    assert made.plain == "  key  one two three four five\n       six seven"
    assert Span(0, 7, "bold") in made.spans
    assert " ".join(
        made.plain[span.start : span.end] for span in made.spans if span.style == "red"
    ).split() == (["one", "two", "three", "four", "five", "six", "seven"])


@given(text=st.text("ab \n", max_size=60), width=st.integers(25, 60))
def test_no_word_is_lost(text: str, width: int) -> None:
    assert "\n".join(hung(text, width)).split() == text.split()
