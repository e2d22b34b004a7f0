"""Pictures as characters: two pixels in each cell, the upper half block in front of the lower one's colour.

Works in every terminal with 24-bit colour. Colours are cut to 5 bits per channel: neighbours that look the
same become the same, so that long runs are written once (measured: a third of the bytes).
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import groupby

from PIL import Image

BLOCK = "▀"
_STEP = 0xF8
"""Mask of the bits of a channel that are kept."""

Colour = tuple[int, int, int]
Run = tuple[int, Colour, Colour]
"""Count of equal cells, colour of their upper and of their lower half."""


def decode(jpeg: bytes, columns: int, rows: int) -> list[list[Run]]:
    """Turn a picture into rows of runs that fit into a field of cells, at its own proportions.

    Args:
        jpeg: the picture.
        columns: width of the field [cells]; a cell is taken as twice as high as wide.
        rows: height of the field [cells].

    Returns:
        Rows from top to bottom; fewer than asked for when the picture is wider than the field.

    Raises:
        OSError: it is no picture.
    """
    with Image.open(io.BytesIO(jpeg)) as picture:
        size = fit(picture.size, columns, rows)
        picture.draft("RGB", size)
        small = picture.convert("RGB").resize(size, Image.Resampling.BOX)
    pixels = small.tobytes()
    width, height = size
    return [list(_runs(pixels, width, row)) for row in range(0, height, 2)]


def fit(size: tuple[int, int], columns: int, rows: int) -> tuple[int, int]:
    """Return the size in pixels (even height) at which a picture fits into a field of cells."""
    width, height = max(size[0], 1), max(size[1], 1)
    scale = min(columns / width, 2 * rows / height)
    return max(round(width * scale), 1), max(2 * round(height * scale / 2), 2)


def _runs(pixels: bytes, width: int, row: int) -> Iterator[Run]:
    upper = _colours(pixels, width, row)
    lower = _colours(pixels, width, row + 1)
    for (one, other), group in groupby(zip(upper, lower, strict=True)):
        yield sum(1 for _ in group), one, other


def _colours(pixels: bytes, width: int, row: int) -> list[Colour]:
    start = 3 * width * row
    line = bytes(value & _STEP for value in pixels[start : start + 3 * width])
    return list(zip(line[0::3], line[1::3], line[2::3], strict=True))
