"""Finding the base's way over the floor: straight where it is free, else around what stands there. Pure.

The floor is a grid of 8 cm; a cell is free when the base's circle, and a margin, fits there between walls,
furniture and people. A* over the eight neighbours (Hart, Nilsson and Raphael 1968), then every corner is cut
that can be cut.
"""

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from robotree.sim.companion.flat import FURNITURE, ROOM
from robotree.sim.companion.guard import Person

GRID: Final = 0.08
"""[m]"""
RADIUS: Final = 0.23
"""[m] of the base with a margin of 2 cm."""
BASE_HEIGHT: Final = 0.62
"""[m] below which furniture is in the base's way; under a table top it may drive."""
COLUMN: Final = 0.16
"""[m] that the trunk keeps from things that are higher, as a table top."""
Point = tuple[float, float]


class Blocked(NamedTuple):
    """An obstacle on the way."""

    what: str
    person: bool


class Floor:
    """The area that is free for the middle of the base.

    Args:
        people: who stands where.
        distance: to keep from each [m], from middle to middle.
    """

    def __init__(self, people: Sequence[Person], distance: float) -> None:
        self._people, self._distance = people, distance

    def blocked(self, at: Point) -> Blocked | None:
        """Return the obstacle at a place; None: it is free."""
        x, y = at
        if not (ROOM[0] + RADIUS <= x <= ROOM[1] - RADIUS and ROOM[2] + RADIUS <= y <= ROOM[3] - RADIUS):
            return Blocked("a wall", person=False)
        for box in FURNITURE:
            keep = RADIUS if box.at[2] - box.half[2] < BASE_HEIGHT else COLUMN
            dx, dy = max(abs(x - box.at[0]) - box.half[0], 0.0), max(abs(y - box.at[1]) - box.half[1], 0.0)
            if math.hypot(dx, dy) < keep:
                return Blocked(f"the {box.name.replace('_', ' ')}", person=False)
        for person in self._people:
            if math.dist(at, person.at) < self._distance:
                return Blocked(person.name, person=True)
        return None

    def on_the_line(self, start: Point, end: Point) -> Blocked | None:
        """Return the obstacle on a line; the first 10 cm, where the base stands already, do not count."""
        length = math.dist(start, end)
        count = max(1, math.ceil(length / (0.5 * GRID)))
        for i in range(1, count + 1):
            share = i / count
            at = (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
            if (blocked := self.blocked(at)) is not None and not self._leaving(blocked, start, at):
                return blocked
        return None

    def route(self, start: Point, end: Point) -> list[Point] | Blocked:
        """The corners of a way from `start`, which is not among them, to `end`; or what is in its way."""
        if (blocked := self.blocked(end)) is not None:
            return blocked
        if (direct := self.on_the_line(start, end)) is None:
            return [end]
        cells = _search(start, end, lambda at: self.blocked(at) is None)
        if cells is None:
            return direct
        return self._shortened(start, [*cells, end])

    def _leaving(self, blocked: Blocked, start: Point, at: Point) -> bool:
        """Whether the base is too near already where it stands, and this place is further away."""
        if not blocked.person or self.blocked(start) is None:
            return False
        person = next(each for each in self._people if each.name == blocked.what)
        return math.dist(at, person.at) > math.dist(start, person.at)

    def _shortened(self, start: Point, corners: list[Point]) -> list[Point]:
        way: list[Point] = []
        here, i = start, 0
        while i < len(corners):
            furthest = i
            for j in range(len(corners) - 1, i, -1):
                if self.on_the_line(here, corners[j]) is None:
                    furthest = j
                    break
            here = corners[furthest]
            way.append(here)
            i = furthest + 1
        return way


def _search(start: Point, end: Point, free: Callable[[Point], bool]) -> list[Point] | None:
    """Places of the grid between `start` and `end`; None: there is no way."""

    def place(cell: tuple[int, int]) -> Point:
        return cell[0] * GRID, cell[1] * GRID

    first = round(start[0] / GRID), round(start[1] / GRID)
    last = round(end[0] / GRID), round(end[1] / GRID)
    costs: dict[tuple[int, int], float] = {first: 0.0}
    before: dict[tuple[int, int], tuple[int, int]] = {}
    known: dict[tuple[int, int], bool] = {first: True, last: True}
    queue = [(math.dist(first, last), first)]
    while queue:
        _, cell = heapq.heappop(queue)
        if cell == last:
            return [place(each) for each in _back(before, first, last)]
        for neighbour, step in _neighbours(cell):
            if neighbour not in known:
                known[neighbour] = free(place(neighbour))
            cost = costs[cell] + step
            if known[neighbour] and cost < costs.get(neighbour, math.inf) - 1e-9:
                costs[neighbour], before[neighbour] = cost, cell
                heapq.heappush(queue, (cost + math.dist(neighbour, last), neighbour))
    return None


def _neighbours(cell: tuple[int, int]) -> Iterator[tuple[tuple[int, int], float]]:
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            if dx or dy:
                yield (cell[0] + dx, cell[1] + dy), math.hypot(dx, dy)


def _back(
    before: dict[tuple[int, int], tuple[int, int]], first: tuple[int, int], last: tuple[int, int]
) -> list[tuple[int, int]]:
    cells: list[tuple[int, int]] = []
    cell = last
    while cell != first:
        cell = before[cell]
        if cell != first:
            cells.append(cell)
    return cells[::-1]
