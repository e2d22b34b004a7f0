"""A paste has a largest size, wherever its marks are cut; keys before and behind it are keys."""

from __future__ import annotations

import itertools
import tracemalloc

from hypothesis import given
from hypothesis import strategies as st
from textual._xterm_parser import XTermParser
from textual.events import Key, Paste
from textual.message import Message

from robotree.tui.screen.driver import BEGIN, END, LONGEST, BoundedPaste

PARTS = st.lists(
    st.sampled_from([BEGIN, END, "\x1b[", "\x1b[20", "a", "q\n", "\x1b[A", "ü", " "]), max_size=12
)


def read(parser: XTermParser, text: str, cuts: list[int]) -> list[str]:
    found: list[Message] = []
    edges = [0, *sorted({min(cut, len(text)) for cut in cuts}), len(text)]
    for begin, end in itertools.pairwise(edges):
        if begin < end:
            found += parser.feed(text[begin:end])
    return [f"{one.key}" if isinstance(one, Key) else f"<{one.text}>" for one in found
            if isinstance(one, Key | Paste)]  # fmt: skip


@given(PARTS, st.lists(st.integers(0, 60), max_size=6))
def test_what_is_not_too_long_is_read_as_before_however_it_is_cut(parts: list[str], cuts: list[int]) -> None:
    text = f"x{''.join(parts)}{END}y"
    assert read(BoundedPaste(), text, cuts) == read(XTermParser(), text, cuts)


def test_a_paste_without_an_end_fills_no_memory_and_the_keys_behind_it_are_keys() -> None:
    parser, piece = BoundedPaste(), "spam and eggs " * 1000
    list(parser.feed(BEGIN))
    tracemalloc.start()
    for _ in range(300):  # 4 million characters
        assert not list(parser.feed(piece))
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 12 * LONGEST, held
    (paste, key) = [one for one in parser.feed(f"{END}q") if isinstance(one, Key | Paste)]
    assert isinstance(paste, Paste)
    assert len(paste.text) == LONGEST
    assert isinstance(key, Key)
    assert key.key == "q"
