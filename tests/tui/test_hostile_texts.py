"""Texts from afar: they do not control the terminal of the reader, and take exactly their cells."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.grammar import parse
from robotree.tui.line.shell import Console, obey
from robotree.tui.screen.app import ControlFilter
from robotree.tui.seen.cells import clip, fit, seen
from robotree.tui.terminal import STEERING, harmless

if TYPE_CHECKING:
    from conftest import Hostile, Realm

SHELL = shapes(Where.SHELL)


@pytest.mark.parametrize(
    "code", [*range(9), *range(0x0B, 0x20), 0x7F, *range(0x80, 0xA0), 0x200E, 0x202E, 0x2066]
)
def test_what_steers_goes_out_by_its_number(code: int) -> None:
    assert harmless(f"a{chr(code)}b") == f"a\\u{code:04x}b"
    assert json.loads(harmless(json.dumps(f"a{chr(code)}b", ensure_ascii=False))) == f"a{chr(code)}b"


def test_words_of_all_languages_and_layout_stay_as_they_are() -> None:
    text = "Grüße 你好 שלום 👩\u200d🚀 ▶ ━\n\t'\"\\\\"
    assert harmless(text) == text


@pytest.mark.parametrize(
    "words",
    [
        ["ls"],
        ["tree"],
        ["show", "evil"],
        ["call", "evil.speak"],
        ["call", "evil.stumble"],
        ["call", "evil.advance"],
        ["watch", "evil", "--within", "100ms"],
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("as_json", [False, True])
async def test_no_verb_lets_a_robot_steer_the_terminal(
    words: list[str],
    as_json: bool,  # noqa: FBT001 # a case
    realm: Realm,
    hostile: Hostile,
    capsys: pytest.CaptureFixture[str],
) -> None:
    await realm.robot(hostile)
    await obey(realm.realm_client, parse(words, SHELL, {}), Console(as_json=as_json))
    said = capsys.readouterr()
    assert STEERING.search(said.out + said.err) is None
    if words[-1] == "evil.stumble":
        assert said.err.count("\n") == 1, "what it tells is one line, so it cannot tell a second thing"
        assert "\\u001b[2J" in said.err
    if as_json and words[-1] == "evil.speak":
        assert json.loads(said.out) == hostile.words, "programs get every character"


def test_taking_away_what_steers_moves_nothing(hostile: Hostile) -> None:
    from rich.cells import cell_len
    from rich.segment import Segment
    from rich.style import Style
    from textual.color import Color

    line = [Segment("plain "), Segment(hostile.words, Style(bold=True))]
    shown = ControlFilter().apply(line, Color(0, 0, 0))
    assert shown[0] == line[0]
    assert shown[1].style == Style(bold=True)
    assert sum(cell_len(one.text) for one in shown) == sum(cell_len(one.text) for one in line)


# -- text in a fixed number of cells, whatever comes from afar -------------------------------------

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
