"""Whatever is typed is understood, or refused in a sentence."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.tui.errors import SupervisorError
from robotree.tui.line import manual
from robotree.tui.line.action import Where
from robotree.tui.line.surface import Surface
from robotree.vr.base.errors import VrError

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
