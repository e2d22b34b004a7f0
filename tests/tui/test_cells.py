"""Text in a fixed number of cells, whatever comes from afar."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from robotree.tui.seen.cells import clip, fit, seen
from robotree.tui.terminal import STEERING

NAMES = st.one_of(
    st.text(),
    st.text("aß界👩\u200d🚀\u0301\u202e\x1b[]\n\t \x9b"),
    st.sampled_from(["机器人" * 9, "[/x]", ""]),
)


@given(text=NAMES, room=st.integers(0, 60))
def test_a_text_takes_exactly_its_cells(text: str, room: int) -> None:
    assert cell_len(fit(text, room)) == room
    assert cell_len(clip(text, room)) <= room


@given(text=NAMES, room=st.integers(1, 60))
def test_what_was_cut_says_so_and_what_fits_is_whole(text: str, room: int) -> None:
    shown = clip(text, room)
    whole = cell_len(seen(text)) <= room
    assert (shown == seen(text)) if whole else shown.endswith("…")


@given(text=NAMES)
def test_nothing_steers_and_nothing_breaks_a_line(text: str) -> None:
    assert not STEERING.search(seen(text))
    assert "\n" not in seen(text)
