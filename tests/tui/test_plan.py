"""The plan from above: what stands where, in characters."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.seen.frames import ground_of
from robotree.tui.seen.plan import (
    CURSOR,
    GOAL,
    REFUSED,
    STEP,
    Mark,
    PlanScene,
    Window,
    carried,
    drawn,
    fitting,
)
from robotree.tui.seen.plan import heading_sign as sign
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec

metres = st.floats(-50.0, 50.0)


def text(scene: PlanScene, window: Window, cursor: tuple[int, int] | None = None) -> list[str]:
    return ["".join(words for _, words in row) for row in drawn(scene, window, cursor)]


@given(
    points=st.lists(st.tuples(metres, metres), max_size=9),
    columns=st.integers(8, 200),
    rows=st.integers(4, 80),
)
def test_all_is_seen_and_lines_fill_the_field(
    points: list[tuple[float, float]], columns: int, rows: int
) -> None:
    window = fitting(points, columns, rows)
    assert all(window.holds(point) for point in points)
    scene = PlanScene(tuple(Mark(x, y, "●", "success", "name") for x, y in points))
    lines = text(scene, window, (0, 0))
    assert [len(line) for line in lines] == [columns] * rows
    assert lines[0][0] == CURSOR


@given(column=st.integers(0, 79), row=st.integers(0, 23))
def test_a_cell_is_its_own_point(column: int, row: int) -> None:
    window = Window(0.3, -0.2, 0.05, 80, 24)
    assert window.cell(window.point(column, row)) == (column, row)


def test_x_is_up_and_y_is_left() -> None:
    window = Window(0.0, 0.0, 0.1, 40, 20)
    (column, row), (ahead, up), (left, same) = (window.cell(p) for p in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5)))
    assert (ahead, up) == (column, row - 5)
    assert (left, same) == (column - 10, row)
    assert [sign(turn * math.pi / 2) for turn in range(4)] == ["↑", "←", "↓", "→"]


@pytest.mark.parametrize("rows", range(16, 44))
def test_the_points_of_the_grid_are_equally_far_apart(rows: int) -> None:
    window = fitting([(0.196, 0.0), (0.35, 0.25)], 120, rows)
    lines = text(PlanScene(), window)
    marked = [at for at, line in enumerate(lines[:-1]) if re.match(r"-?\d", line)]
    assert len({after - before for before, after in pairwise(marked)}) <= 1, lines


@pytest.mark.parametrize("rows", range(16, 44))
def test_the_distances_of_both_edges_never_cover_each_other(rows: int) -> None:
    for columns in range(60, 100):
        last = text(PlanScene(), Window(0.0, 0.0, 0.05, columns, rows))[-1]
        across = [float(label) for label in re.findall(r"-?\d[\d.]*", last)]
        assert all(abs(before - after - 0.2) < 1e-6 for before, after in pairwise(across)), last


def test_the_way_leads_to_its_goal_and_a_refused_goal_looks_different() -> None:
    window = Window(0.0, 0.0, 0.1, 40, 20)
    scene = PlanScene((Mark(0.0, 0.0, "●", "success", "arm-1"),), ((0.0, 0.0), (0.5, 0.5)), (0.5, 0.5))
    lines = text(scene, window)
    assert "●arm-1" in lines[window.cell((0.0, 0.0))[1]]
    assert sum(line.count(STEP) for line in lines) >= 5
    assert lines[window.cell((0.5, 0.5))[1]][window.cell((0.5, 0.5))[0]] == GOAL
    refused = drawn(scene._replace(refused=True), window)
    assert any(tone == "error" and REFUSED in words for row in refused for tone, words in row)


def test_names_never_cover_signs_or_each_other() -> None:
    window = Window(0.0, 0.0, 0.1, 30, 9)
    marks = tuple(Mark(0.0, -0.05 * i, "●", "success", "robot") for i in range(4))
    line = text(PlanScene(marks), window)[window.cell((0.0, 0.0))[1]]
    assert line.count("●") == 4
    assert line.count("robot") == 2, "one to the left of the first, one to the right of the last"


def test_a_virtual_robot_is_on_the_plan_of_those_that_it_commands() -> None:
    arm, square = Address("robot", "arm-1", "1"), Address("robot", "square", "2")
    robots = {
        "arm-1": RobotDescription(address=arm, kinds=("Arm",), attributes={"controller": "tcp://cell:1"}),
        "square": RobotDescription(
            address=square, kinds=("Square",), slots=(SlotSpec(name="arm", kind="Arm", child=arm),)
        ),
    }
    assert ground_of(robots["square"], robots) == "tcp://cell:1"


def test_what_a_body_carries_turns_with_it() -> None:
    assert carried(1.0, 0.0, {"x": 2.0, "y": 3.0, "heading": math.pi / 2}) == pytest.approx((2.0, 4.0))
    assert carried(1.0, 0.0, {"x": 2.0, "y": 3.0}) is None
