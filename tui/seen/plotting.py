"""Plots made of braille signs: two dots across and four down in each cell. Pure.

A plot is drawn anew many times a second, so its work is bounded by its cells: however many values there are,
each column of dots shows the least and the greatest of those that came in its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10

_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""Bits of a braille sign, by column and row (Unicode 16, chapter 21)."""
_EMPTY = 0x2800
MARGIN = 0.05
"""Share of the range that is left free above and below."""
FLAT = 1e-9
"""Range up to which values count as equal."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a plot."""

    times: Sequence[float]
    values: Sequence[float]


@dataclass(frozen=True, slots=True)
class Frame:
    """The part of the plane that is shown."""

    left: float
    right: float
    low: float
    high: float


def range_of(values: Sequence[float], *marks: float, least: float = 0.0) -> tuple[float, float]:
    """Return from where to where values are shown: all of them, and the marks, with a margin.

    Args:
        values: of the curve.
        marks: further values.
        least: the least range: what differs by less is noise.
    """
    found = [*values, *marks]
    if not found:
        return 0.0, 1.0
    low, high = min(found), max(found)
    if high - low <= FLAT * max(abs(low), abs(high), 1.0):
        room = max(abs(high), 1.0) * MARGIN
        return low - room, high + room
    room = max((high - low) * MARGIN, (least - (high - low)) / 2)
    return low - room, high + room


def steady(old: tuple[float, float] | None, new: tuple[float, float]) -> tuple[float, float]:
    """Return the range to be shown: the old one while the new one fits and fills half of it.

    A scale that changes with each value makes a calm line look restless.
    """
    if old is None or new[0] < old[0] or new[1] > old[1]:
        return new
    return old if new[1] - new[0] > (old[1] - old[0]) / 2 else new


class Canvas:
    """Cells of braille signs; each has the colour of the curve that came last there."""

    def __init__(self, width: int, height: int) -> None:
        """Make an empty canvas of so many cells."""
        self.width, self.height = width, height
        self._bits = [bytearray(width) for _ in range(height)]
        self._whose = [bytearray(width) for _ in range(height)]

    def column(self, x: int, top: int, bottom: int, whose: int) -> None:
        """Set the dots of one column of dots, from row `top` to row `bottom`."""
        cell, bits = x >> 1, _DOTS[x & 1]
        for y in range(max(top, 0), min(bottom, 4 * self.height - 1) + 1):
            self._bits[y >> 2][cell] |= bits[y & 3]
            self._whose[y >> 2][cell] = whose

    def row(self, y: int, whose: int, step: int = 4) -> None:
        """Set each `step`-th dot of one row of dots where nothing is yet: a threshold."""
        if 0 <= y < 4 * self.height:
            for x in range(0, 2 * self.width, step):
                if not self._bits[y >> 2][x >> 1]:
                    self._bits[y >> 2][x >> 1] |= _DOTS[x & 1][y & 3]
                    self._whose[y >> 2][x >> 1] = whose

    def lines(self) -> list[list[tuple[str, int]]]:
        """Return each line as texts with the number of their curve; 0: none."""
        found: list[list[tuple[str, int]]] = []
        for bits, whose in zip(self._bits, self._whose, strict=True):
            runs: list[tuple[str, int]] = []
            start = 0
            for x in range(1, self.width + 1):
                if x == self.width or whose[x] != whose[start]:
                    text = "".join(chr(_EMPTY + bit) if bit else " " for bit in bits[start:x])
                    runs.append((text, whose[start]))
                    start = x
            found.append(runs)
        return found


def over_time(canvas: Canvas, curve: Curve, frame: Frame, marks: Sequence[float] = ()) -> None:
    """Draw a curve over time, from the least to the greatest value in a column of dots; 1, its marks 2."""
    wide, high = 2 * canvas.width, 4 * canvas.height
    across, down = wide / (frame.right - frame.left), (high - 1) / (frame.high - frame.low)
    before: int | None = None
    column, top, bottom = -1, high, -1
    for time, value in zip(curve.times, curve.values, strict=True):
        x = int((time - frame.left) * across)
        y = min(max(round((frame.high - value) * down), 0), high - 1)
        if x != column:
            if 0 <= column < wide and bottom >= 0:
                canvas.column(column, top, bottom, 1)
                if before is not None:  # the value holds until the next one came
                    for held in range(column + 1, min(x, wide)):
                        canvas.column(held, before, before, 1)
            column, top, bottom = x, y, y
            if before is not None and x >= 0:  # a line, not a cloud of dots
                top, bottom = min(top, before), max(bottom, before)
        else:
            top, bottom = min(top, y), max(bottom, y)
        before = y
    if 0 <= column < wide and bottom >= 0:
        canvas.column(column, top, bottom, 1)
    for mark in marks:
        canvas.row(round((frame.high - mark) * down), 2)


def against(canvas: Canvas, across: Sequence[float], up: Sequence[float], frame: Frame) -> None:
    """Draw the values of one reading against those of another at the same moments."""
    wide, high = 2 * canvas.width, 4 * canvas.height
    for x, y in zip(across, up, strict=True):
        column = round((x - frame.left) / (frame.right - frame.left) * (wide - 1))
        row = round((frame.high - y) / (frame.high - frame.low) * (high - 1))
        if 0 <= column < wide:
            canvas.column(column, row, row, 1)
    if across:
        column = round((across[-1] - frame.left) / (frame.right - frame.left) * (wide - 1))
        row = round((frame.high - up[-1]) / (frame.high - frame.low) * (high - 1))
        for dot in (-1, 0, 1):
            if 0 <= column + dot < wide:
                canvas.column(column + dot, row - 1, row + 1, 2)


def together(one: Curve, other: Curve) -> tuple[list[float], list[float]]:
    """Return the values of two curves at the moments of the second one: of the first that which held then."""
    found: tuple[list[float], list[float]] = [], []
    at, last = 0, None
    for time, value in zip(other.times, other.values, strict=True):
        while at < len(one.times) and one.times[at] <= time:
            last = one.values[at]
            at += 1
        if last is not None:
            found[0].append(last)
            found[1].append(value)
    return found


def aligned(end: float, window: float, dots: int) -> float:
    """Return the end of the time that is shown, so that a plot moves on by whole columns of dots."""
    step = window / max(dots, 1)
    return (floor(end / step) + 1) * step


FINE = 1e-4
"""Range of an axis below which its numbers have an exponent."""


def label(value: float, span: float) -> str:
    """Write a number at an axis with as many digits as its range can tell apart."""
    if 0 < span < FINE and abs(value) < 100 * span:
        return f"{value:.3g}".replace("e-0", "e-")
    digits = min(max(2 - floor(log10(span)), 0), 6) if span > 0 else 3
    return f"{value:.{digits}f}"
