"""A search leaves of a text the lines with the letters, and what they belong to."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from robotree.tui.screen.hanging import containing

HELP = """\
On every page
  space      stops every robot
  ?          help
Verbs
  stop [NAME]
      Stop all robots, or one.
  tree
      Show the robots as trees.
"""


@pytest.mark.parametrize(
    ("letters", "kept"),
    [
        ("HELP", ["On every page", "  ?          help"]),
        ("tree", ["Verbs", "  tree", "      Show the robots as trees."]),
        ("or one", ["Verbs", "  stop [NAME]", "      Stop all robots, or one."]),
        ("nothing like it", [""]),
    ],
)
def test_a_line_is_kept_with_its_title_and_what_explains_it(letters: str, kept: list[str]) -> None:
    assert containing(Text(HELP), letters).plain.split("\n") == kept


@given(text=st.text("ab \n", max_size=60), letters=st.text("ab", min_size=1, max_size=3))
def test_a_search_adds_no_line_and_loses_none_that_has_the_letters(text: str, letters: str) -> None:
    found = containing(Text(text), letters).plain.split("\n")
    lines = text.split("\n")
    assert len(found) <= len(lines)
    assert [line for line in lines if letters in line] == [line for line in found if letters in line]
