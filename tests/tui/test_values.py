"""Small values are read, or refused in one sentence."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.errors import ValueRefused
from robotree.tui.line import values


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
