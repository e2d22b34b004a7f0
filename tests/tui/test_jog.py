"""Tele-operation: steps add up, stay in bounds and on a lead_limit, and never queue."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robotree.tui.screen.jog import AXES, STEPS, Jog, lead_limit

HOME = {"x": 0.4, "y": 0.0, "z": 0.3, "twist": 0.0}
BOUNDS = {"x": (0.2, 0.6), "y": (-0.4, 0.4), "z": (0.05, 0.5), "twist": (-3.0, 3.0)}


def test_presses_during_a_movement_become_one_movement() -> None:
    jog = Jog(BOUNDS)
    jog.press("x", +1, HOME)
    assert jog.take() == pytest.approx({**HOME, "x": 0.41}), "one step of one axis"
    jog.press("x", +1, HOME)
    jog.press("y", -1, HOME)
    assert jog.take() is None, "one goes at a time"
    jog.arrived()
    assert jog.take() == pytest.approx({**HOME, "x": 0.42, "y": -0.01})
    jog.arrived()
    assert jog.take() is None, "nothing new is not sent again"


def test_steps_add_up_exactly_although_the_robot_yields() -> None:
    jog = Jog(BOUNDS)
    for _ in range(2):
        jog.press("x", +1, {**HOME, "x": 0.4 + 0.0007})
        jog.take()
        jog.arrived()
    assert jog.target is not None
    assert jog.target["x"] == pytest.approx(0.4 + 0.0007 + 0.02)


def test_a_robot_that_is_held_back_is_not_asked_for_more_and_more() -> None:
    jog = Jog(BOUNDS)
    for _ in range(50):
        jog.press("z", -1, HOME)
        jog.take()
        jog.arrived()
    assert jog.target is not None
    assert jog.target["z"] == pytest.approx(HOME["z"] - lead_limit("z", 0.01))


def test_five_quick_jogs_of_10_mm_move_50_mm() -> None:
    jog = Jog(BOUNDS)
    assert [jog.press("x", +1, HOME) for _ in range(5)] == [0.0] * 5
    assert jog.take() == pytest.approx({**HOME, "x": 0.45})


def test_what_is_dropped_is_told_to_the_micrometre() -> None:
    jog = Jog(BOUNDS)
    dropped = [jog.press("x", +1, HOME) for _ in range(8)]
    assert dropped == pytest.approx([0.0] * 6 + [0.01] * 2)
    assert jog.short(HOME) == pytest.approx(0.06)
    jog.resize(+9)
    jog.drop()
    assert jog.press("y", +1, {**HOME, "y": 0.37}) == pytest.approx(0.02), "the bound is at 0.4"


@given(step=st.sampled_from(STEPS))
def test_the_leash_is_never_shorter_than_three_steps_nor_longer_than_it_must(step: float) -> None:
    assert 3 * step - 1e-12 <= lead_limit("x", step) <= max(3 * step, 0.06) + 1e-12


def test_after_a_refusal_the_next_step_starts_where_the_robot_is() -> None:
    jog = Jog(BOUNDS)
    jog.press("x", +1, HOME)
    jog.take()
    jog.drop()
    assert jog.take() is None
    jog.press("x", +1, {**HOME, "x": 0.3})
    assert jog.take() == pytest.approx({**HOME, "x": 0.31})


@given(by=st.lists(st.sampled_from([-1, 1]), max_size=30))
def test_a_step_can_be_changed_within_its_choices(by: list[int]) -> None:
    jog = Jog(BOUNDS)
    for one in by:
        jog.resize(one)
        assert STEPS[0] <= jog.step("x") <= STEPS[-1]


class Operator(RuleBasedStateMachine):
    """An operator who presses anything at any time, over a robot that follows more or less."""

    def __init__(self) -> None:
        super().__init__()
        self.jog = Jog(BOUNDS)
        self.actual = dict(HOME)
        self.before: dict[str, float] | None = None

    @rule(axis=st.sampled_from(AXES), direction=st.sampled_from([-1, 1]))
    def press(self, axis: str, direction: int) -> None:
        before = (self.jog.target or self.actual)[axis]
        dropped = self.jog.press(axis, direction, self.actual)
        assert self.jog.target is not None
        moved = (self.jog.target[axis] - before) * direction
        assert -1e-12 <= moved <= self.jog.step(axis) + 1e-12
        if moved > 1e-12:
            ahead = (self.jog.target[axis] - self.actual[axis]) * direction
            assert ahead <= lead_limit(axis, self.jog.step(axis)) + 1e-12
        assert moved + dropped == pytest.approx(self.jog.step(axis), abs=1e-5), "nothing is lost silently"

    @rule(by=st.sampled_from([-1, 1]))
    def resize(self, by: int) -> None:
        self.jog.resize(by)

    @precondition(lambda self: not self.jog.moving)
    @rule()
    def send(self) -> None:
        self.jog.take()

    @precondition(lambda self: self.jog.moving)
    @rule(share=st.floats(0, 1))
    def arrive(self, share: float) -> None:
        assert self.jog.sent is not None
        for axis in AXES:
            self.actual[axis] += share * (self.jog.sent[axis] - self.actual[axis])
        self.jog.arrived()

    @rule()
    def drop(self) -> None:
        self.jog.drop()

    @invariant()
    def inside_the_bounds(self) -> None:
        for axis, (lower, upper) in BOUNDS.items():
            assert lower <= (self.jog.target or self.actual)[axis] <= upper


TestOperator = Operator.TestCase
