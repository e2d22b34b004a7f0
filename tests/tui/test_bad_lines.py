"""Every verb with every wrong argument: one sentence, one JSON value, an exit code, and nothing is done."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.errors import SupervisorError
from robotree.tui.line import manual
from robotree.tui.line.action import Where
from robotree.tui.line.surface import Surface
from robotree.vr.base.errors import VrError

VERBS = [action.verb for action in manual.shell().actions if action.verb not in {"help", "quit"}]
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


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(
    "wrong", ["--nosuch", "--json=yes", "--realm", "--within=soon --nosuch", "a/b c d e f g h"]
)
def test_a_wrong_argument_is_one_sentence_and_one_value(
    verb: str, wrong: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main([*verb.split(), *wrong.split()])
    said = capsys.readouterr()
    takes_any_words = verb in {
        "record",
        "say",
    }  # a file, and robots: only that nobody is there can be wrong then
    assert code in {exit_codes.USAGE, exit_codes.REFUSED} | (
        {exit_codes.NOBODY} if takes_any_words else set()
    )
    assert said.out == ""
    assert said.err.startswith("robotree: ")
    assert said.err.count("\n") == 1
    if wrong != "--json=yes":
        assert main([*verb.split(), "--json", *wrong.split()]) == code
        told = capsys.readouterr()
        assert json.loads(told.out) == json.loads(told.err)
    assert list(place.iterdir()) == [], "nothing was begun"
