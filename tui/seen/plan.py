"""A plan of a place from above: robots, named places, the way and its goal, as characters. Pure.

Frame: W of the cell as robots are commanded in it. On the screen x is up and y is left, so that a robot at
its origin that looks along x looks up. A cell of a terminal is taken as twice as high as wide.

Each character has a tone, the name of a variable of the theme; signs differ too, so that a plan can be read
in 16 colours and in none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

GOAL, REFUSED, STEP, PLACE, CURSOR, JOINT = "◎", "✗", "•", "▪", "┼", "●"
"""Signs of the goal, of one that is refused, of a point of the way, of a named place, the cursor, a joint."""
ARROWS = "↑↖←↙↓↘→↗"
"""Of headings, from along x on, counterclockwise."""
SMALLEST = 1.0
"""[m] that a plan shows at least, in each direction."""
MARGIN = 1.2
"""Times as much as what is shown, so that nothing stands at the edge."""
ROUND = (1.0, 2.0, 5.0)
"""Scales change in these steps, so that a plan stands still while robots move."""
GRID = 8
"""Columns between two points of the grid, at least."""

EDGE = 1e-6
"""Cells: what lies on the edge between two, but for rounding, is in the second one."""

Point = tuple[float, float]
"""[m] x, y in W."""
Run = tuple[str, str]
"""Tone and text of neighbours that look the same."""


class Mark(NamedTuple):
    """Something that stands somewhere."""

    x: float
    y: float
    sign: str
    tone: str
    words: str = ""
    """Written beside it where there is room."""


class PlanScene(NamedTuple):
    """What a plan shows."""

    marks: tuple[Mark, ...] = ()
    """The most important ones last: they are drawn over the others."""
    way: tuple[Point, ...] = ()
    goal: Point | None = None
    refused: bool = False
    """The robot would not go to the goal."""

    @property
    def points(self) -> list[Point]:
        """Everything that should be seen."""
        return [*((mark.x, mark.y) for mark in self.marks), *self.way, *([self.goal] if self.goal else [])]


class Window(NamedTuple):
    """The part of W that is seen, and how large."""

    x: float
    y: float
    """[m] its middle."""
    scale: float
    """[m] of a line; a column is half of that."""
    columns: int
    rows: int

    def cell(self, point: Point) -> tuple[int, int]:
        """Return column and row of a point; they may lie outside."""
        column = self.columns / 2 - (point[1] - self.y) * 2 / self.scale
        row = self.rows / 2 - (point[0] - self.x) / self.scale
        return math.floor(column + EDGE), math.floor(row + EDGE)

    def point(self, column: int, row: int) -> Point:
        """Return the middle of a cell [m]."""
        return (
            self.x + (self.rows / 2 - row - 0.5) * self.scale,
            self.y + (self.columns / 2 - column - 0.5) * self.scale / 2,
        )

    def holds(self, point: Point) -> bool:
        """Whether a point is seen."""
        column, row = self.cell(point)
        return 0 <= column < self.columns and 0 <= row < self.rows


def rounded_up(value: float) -> float:
    """Return the next of 1, 2, 5, 10, 20, … times a power of ten that is no smaller."""
    power = 10.0 ** math.floor(math.log10(value))
    return next((step * power for step in ROUND if step * power >= value * (1 - 1e-9)), 10.0 * power)


def fitting(points: Iterable[Point], columns: int, rows: int) -> Window:
    """Return the window in which all points are seen; without any, the surroundings of the origin."""
    found = [*points] or [(0.0, 0.0)]
    xs, ys = [x for x, _ in found], [y for _, y in found]
    high = max((max(xs) - min(xs)) * MARGIN, SMALLEST) / max(rows, 1)
    wide = max((max(ys) - min(ys)) * MARGIN, SMALLEST) * 2 / max(columns, 1)
    scale = rounded_up(max(high, wide))
    middle = [round((max(each) + min(each)) / 2 / scale) * scale for each in (xs, ys)]
    return Window(middle[0], middle[1], scale, columns, rows)


def heading_sign(heading: float) -> str:
    """Return the arrow of a heading [rad], counterclockwise from x, which is up."""
    return ARROWS[round(heading / (math.pi / 4)) % len(ARROWS)]


def drawn(scene: PlanScene, window: Window, cursor: tuple[int, int] | None = None) -> list[list[Run]]:
    """Return the lines of a plan, from above, each as runs; `cursor` is its column and row."""
    field = _Field(window.columns, window.rows)
    _grid(field, window)
    tone = "error" if scene.refused else "accent"
    for one, other in zip(scene.way, scene.way[1:], strict=False):
        (c, r), (d, s) = window.cell(one), window.cell(other)
        steps = min(max(abs(d - c), abs(s - r), 1), 2 * (window.columns + window.rows))
        for step in range(steps + 1):
            field.put(c + (d - c) * step // steps, r + (s - r) * step // steps, STEP, tone)
    for mark in scene.marks:
        field.put(*window.cell((mark.x, mark.y)), mark.sign, mark.tone, taken=True)
    if scene.goal is not None:
        field.put(*window.cell(scene.goal), REFUSED if scene.refused else GOAL, tone, taken=True)
    for mark in reversed(scene.marks):
        if mark.words:
            field.label(*window.cell((mark.x, mark.y)), mark.words, mark.tone)
    if cursor is not None:
        field.put(*cursor, CURSOR, "cursor")
    return field.runs()


def _grid(field: _Field, window: Window) -> None:
    """Draw a point each round distance, the axes of W, and the distances at the edges."""
    step = rounded_up(window.scale / 2 * GRID)
    left, right = window.point(0, 0)[1], window.point(window.columns - 1, 0)[1]
    top, bottom = window.point(0, 0)[0], window.point(0, window.rows - 1)[0]
    across = [i * step for i in range(math.ceil(right / step), math.floor(left / step) + 1)]
    along = [i * step for i in range(math.ceil(bottom / step), math.floor(top / step) + 1)]
    for x in along:
        for y in across:
            field.put(*window.cell((x, y)), "+" if not (x or y) else "·", "muted")
    for x in along:
        row = window.cell((x, window.y))[1]
        if row < window.rows - 1:  # there the distances across stand
            field.text(0, row, f"{x:g}", "muted")
    for y in across:
        column = window.cell((window.x, y))[0]
        field.text(column, window.rows - 1, f"{y:g}", "muted")


class _Field:
    """Cells that are filled."""

    def __init__(self, columns: int, rows: int) -> None:
        self._columns, self._rows = columns, rows
        self._cells: list[list[tuple[str, str]]] = [[("", " ")] * columns for _ in range(rows)]
        self._taken = set[tuple[int, int]]()

    def put(self, column: int, row: int, sign: str, tone: str, *, taken: bool = False) -> None:
        if 0 <= column < self._columns and 0 <= row < self._rows:
            self._cells[row][column] = tone, sign
            if taken:
                self._taken.add((column, row))

    def text(self, column: int, row: int, words: str, tone: str) -> None:
        if column + len(words) <= self._columns:
            for at, letter in enumerate(words):
                self.put(column + at, row, letter, tone)

    def label(self, column: int, row: int, words: str, tone: str) -> None:
        """Write beside a sign, where no other sign or word is: right of it, left of it, else nowhere."""
        if not (0 <= column < self._columns and 0 <= row < self._rows):
            return
        for begin in (column + 1, column - len(words)):
            cells = [(begin + at, row) for at in range(len(words))]
            if begin >= 0 and begin + len(words) <= self._columns and self._taken.isdisjoint(cells):
                for at, letter in enumerate(words):
                    self.put(begin + at, row, letter, tone, taken=True)
                return

    def runs(self) -> list[list[Run]]:
        return [
            [
                (tone, "".join(sign for _, sign in cells))
                for tone, cells in groupby(row, key=lambda cell: cell[0])
            ]
            for row in self._cells
        ]


def carried(x: float, y: float, base: Mapping[str, float] | None) -> Point | None:
    """Return where a point of a body's frame is in W, by the readings of its base; None: nobody knows."""
    if base is None or not {"x", "y", "heading"} <= base.keys():
        return None
    c, s = math.cos(base["heading"]), math.sin(base["heading"])
    return base["x"] + c * x - s * y, base["y"] + s * x + c * y


def skeleton(points: Sequence[tuple[float, float, float]], columns: int, rows: int) -> list[list[Run]]:
    """Return an arm in lines, by where its joints are in W [m]: from its left side, and from above.

    From the side x leads to the right and z up; from above x leads up and y to the left.
    """
    beside = (columns - 3) // 2
    views = ([(z, -x) for x, _, z in points], [(x, y) for x, y, _ in points])
    both: list[list[list[Run]]] = []
    for places in views:
        joints = tuple(Mark(x, y, JOINT, "primary") for x, y in places[:-1])
        tool = tuple(Mark(x, y, GOAL, "success", "tool") for x, y in places[-1:])
        window = fitting([(0.0, 0.0), *places], beside, rows)
        both.append(drawn(PlanScene((*joints, *tool), tuple(places)), window))
    return [[*left, ("muted", " │ "), *right] for left, right in zip(*both, strict=True)]
