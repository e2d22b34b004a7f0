"""A long row of a table goes on below its last column."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Span, Text

from robotree.tui.screen.hanging import hanging

CONSOLE = Console(width=200)


def broken(text: Text | str, width: int) -> list[str]:
    return hanging(Text(text) if isinstance(text, str) else text, width, CONSOLE).plain.split("\n")


def test_the_last_column_goes_on_below_itself() -> None:
    table = "arm-1  free  An arm that goes to points, gripper down.\n  R    Resume.\n\nend"
    assert broken(table, 40) == [
        "arm-1  free  An arm that goes to points,",
        "             gripper down.",
        "  R    Resume.",
        "",
        "end",
    ]


def test_a_column_that_would_be_too_narrow_begins_on_the_left_again() -> None:
    line = f"{'x' * 30}  {'word ' * 6}".rstrip()
    assert broken(line, 40) == [line], "it is left to be broken by the widget"


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
    assert "\n".join(broken(text, width)).split() == text.split()
