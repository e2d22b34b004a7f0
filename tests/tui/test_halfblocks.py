"""Pictures as characters fit, keep their proportions, and show what was in the picture."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from robotree.tui.seen.halfblocks import decode, fit


def jpeg(width: int, height: int, upper: tuple[int, int, int], lower: tuple[int, int, int]) -> bytes:
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
    rows = decode(jpeg(64, 64, (240, 0, 0), (0, 0, 240)), 16, 8)
    assert len(rows) == 8
    assert all(sum(count for count, _, _ in row) == 16 for row in rows)
    _, top, _ = rows[0][0]
    _, _, bottom = rows[-1][0]
    assert top[0] - top[2] > 140, "red above"
    assert bottom[2] - bottom[0] > 140, "blue below"


def test_what_looks_the_same_is_written_once() -> None:
    assert [len(row) for row in decode(jpeg(64, 64, (80, 80, 80), (80, 80, 80)), 16, 8)] == [1] * 8


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(OSError, match="identify"):
        decode(b"not a picture", 10, 10)
