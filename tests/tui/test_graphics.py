"""Pictures in pixels and in characters: what is sent is what was drawn, and fits the terminal."""

from __future__ import annotations

import base64
import io
import re
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from rich.cells import cell_len

from robotree.tui.seen.graphics import (
    ASK_TMUX,
    DIACRITICS,
    VARIABLE,
    ability,
    kitty,
    placeholders,
    sixel,
    wrapped,
)
from robotree.tui.seen.halfblocks import decode, fit


def jpeg(width: int, height: int) -> bytes:
    picture = Image.new("RGB", (width, height), (200, 30, 40))
    picture.paste((20, 60, 220), (0, 0, width // 2, height))
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=95)
    return file.getvalue()


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"TERM": "xterm-kitty"}, "kitty"),
        ({"TERM": "xterm-256color", "TERM_PROGRAM": "ghostty"}, "kitty"),
        ({"TERM": "foot"}, "sixel"),
        ({"TERM": "xterm-256color", "TERM_PROGRAM": "WezTerm"}, "sixel"),
        ({"TERM": "xterm-256color"}, "cells"),
        ({}, "cells"),
        ({"TERM": "xterm-kitty", "STY": "1.pts"}, "cells"),
        ({"TERM": "xterm-kitty", "NO_COLOR": "1"}, "cells"),
        ({"TERM": "xterm-256color", VARIABLE: "sixel"}, "sixel"),
        ({"TERM": "xterm-kitty", VARIABLE: "cells"}, "cells"),
        ({"TERM": "xterm-kitty", VARIABLE: "what"}, "kitty"),
        ({"TERM": "tmux-256color", "TMUX": "tmux-0/default,1,0", "KITTY_WINDOW_ID": "1"}, "cells"),
    ],
)
def test_what_a_terminal_can_is_read_from_its_environment(environment: dict[str, str], expected: str) -> None:
    assert ability(environment) == expected


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        (("xterm-kitty", "256,title", "on"), "kitty"),
        (("xterm-kitty", "256,title", "off"), "cells"),
        (("foot", "256,sixel,title", "off"), "sixel"),
        (("", "", ""), "cells"),
    ],
)
def test_inside_tmux_its_server_is_asked(answers: tuple[str, ...], expected: str) -> None:
    known = dict(zip(ASK_TMUX, answers, strict=True))
    assert ability({"TERM": "tmux-256color", "TMUX": "x"}, known.__getitem__) == expected


@pytest.mark.parametrize("tmux", [False, True])
def test_kitty_gets_the_pixels_and_answers_nothing(*, tmux: bool) -> None:
    sent = kitty(jpeg(120, 80), 77, 40, 13, tmux=tmux)
    if tmux:
        sent = "".join(
            each.replace("\x1b\x1b", "\x1b") for each in re.findall(r"\x1bPtmux;(.*?)\x1b\\(?=\x1bP|$)", sent)
        )
    parts = re.findall(r"\x1b_G([^;]*);([^\x1b]*)\x1b\\", sent)
    assert all("q=2" in keys for keys, _ in parts)
    assert parts[0][0].startswith("a=T,U=1,q=2,f=24,o=z,s=120,v=80,i=77,c=40,r=13")
    assert [keys[-1] for keys, _ in parts] == ["1"] * (len(parts) - 1) + ["0"]
    pixels = zlib.decompress(base64.b64decode("".join(data for _, data in parts)))
    assert len(pixels) == 120 * 80 * 3
    assert pixels[0] < 60, "blue on the left"
    assert pixels[2] > 150


def test_a_placeholder_is_one_cell_and_names_its_part() -> None:
    cells = placeholders(2, 5)
    assert [cell_len(each) for each in cells] == [1] * 5
    assert [each[1:] for each in cells] == [DIACRITICS[2] + DIACRITICS[column] for column in range(5)]
    assert len(set(DIACRITICS)) == len(DIACRITICS) >= 120


def drawn(text: str, width: int, height: int) -> dict[tuple[int, int], int]:
    """Draw sixels again, as a terminal does: the colour of each pixel."""
    body = text.removesuffix("\x1b\\").partition("q")[2]
    body = re.sub(r"#\d+;2;\d+;\d+;\d+", "", body).removeprefix(f'"1;1;{width};{height}')
    found: dict[tuple[int, int], int] = {}
    for band, line in enumerate(body.split("-")[:-1]):
        for part in line.split("$"):
            number, signs = re.match(r"#(\d+)(.*)", part).groups()  # type: ignore[union-attr]
            signs = re.sub(r"!(\d+)(.)", lambda run: run[2] * int(run[1]), signs)
            for column, sign in enumerate(signs):
                for bit in range(6):
                    if (ord(sign) - 63) >> bit & 1:
                        assert (column, 6 * band + bit) not in found, "no pixel has two colours"
                        found[column, 6 * band + bit] = int(number)
    return found


@settings(max_examples=20)
@given(width=st.integers(2, 90), height=st.integers(2, 40))
def test_each_pixel_of_a_sixel_picture_has_one_colour(width: int, height: int) -> None:
    found = drawn(sixel(jpeg(64, 32), width, height), width, height)
    assert found.keys() == {(x, y) for x in range(width) for y in range(height)}
    assert found[0, 0] != found[width - 1, 0]


def test_tmux_passes_on_what_is_wrapped() -> None:
    assert wrapped("\x1b_Gx\x1b\\", tmux=True) == "\x1bPtmux;\x1b\x1b_Gx\x1b\x1b\\\x1b\\"
    assert wrapped("\x1b_Gx\x1b\\", tmux=False) == "\x1b_Gx\x1b\\"


# -- pictures as characters fit, keep their proportions, and show what was in the picture ----------


def halves(width: int, height: int, upper: tuple[int, int, int], lower: tuple[int, int, int]) -> bytes:
    picture = Image.new("RGB", (width, height), upper)
    picture.paste(lower, (0, height // 2, width, height))
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=95)
    return file.getvalue()


@given(
    size=st.tuples(st.integers(1, 4000), st.integers(1, 4000)),
    columns=st.integers(1, 300),
    rows=st.integers(1, 100),
)
def test_a_picture_fits_and_is_made_of_whole_cells(size: tuple[int, int], columns: int, rows: int) -> None:
    width, height = fit(size, columns, rows)
    assert 1 <= width <= columns
    assert 2 <= height <= 2 * rows
    assert height % 2 == 0


def test_a_wide_picture_fills_the_width_at_its_proportions() -> None:
    assert fit((640, 360), 80, 60) == (80, 44)


def test_upper_and_lower_half_stand_where_they_stood() -> None:
    rows = decode(halves(64, 64, (240, 0, 0), (0, 0, 240)), 16, 8)
    assert len(rows) == 8
    assert all(sum(count for count, _, _ in row) == 16 for row in rows)
    _, top, _ = rows[0][0]
    _, _, bottom = rows[-1][0]
    assert top[0] - top[2] > 140, "red above"
    assert bottom[2] - bottom[0] > 140, "blue below"


def test_what_looks_the_same_is_written_once() -> None:
    assert [len(row) for row in decode(halves(64, 64, (80, 80, 80), (80, 80, 80)), 16, 8)] == [1] * 8


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(OSError, match="identify"):
        decode(b"not a picture", 10, 10)
