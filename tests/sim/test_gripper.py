"""The fingers go where they are sent, or say what stopped them."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotree.sim.arm.hand import SPEED, Grip, Gripper
from robotree.sim.firmware.device import WIDEST

DT = 0.001


def lead(gripper: Gripper, seconds: float, width: float, *, obstacle: float = 0.0) -> float:
    """Ideal fingers that follow at once, down to an obstacle."""
    for _ in range(round(seconds / DT)):
        before = width
        width = max(gripper.advance(DT, width, 0.0), obstacle)
        gripper.advance(0.0, width, (width - before) / DT)
    return width


@given(first=st.floats(0, WIDEST), then=st.floats(0, WIDEST))
def test_free_fingers_arrive_at_the_width(first: float, then: float) -> None:
    gripper = Gripper(first)
    gripper.move(then)
    assert abs(lead(gripper, 1.0, first) - then) < 1e-9
    assert gripper.state is Grip.AT_WIDTH


def test_they_do_not_jump_but_travel() -> None:
    gripper = Gripper(0.06)
    gripper.move(0.0)
    width = lead(gripper, 0.1, 0.06)
    assert gripper.state is Grip.MOVING
    assert abs(width - (0.06 - 0.1 * SPEED)) < 1e-6


def test_stopped_by_an_object_they_hold_it() -> None:
    gripper = Gripper(0.06)
    gripper.move(0.0)
    lead(gripper, 1.0, 0.06, obstacle=0.024)
    assert gripper.state is Grip.HOLDING


def test_a_hand_that_is_shaken_still_holds_what_stands_between_its_fingers() -> None:
    gripper = Gripper(0.08)
    gripper.move(0.0)
    lead(gripper, 1.0, 0.08, obstacle=0.062)
    for speed in (0.003, -0.003):
        gripper.advance(DT, 0.062 + speed * DT, speed)
        assert gripper.state is Grip.HOLDING, "the base has begun to drive: a tenth of a millimetre"


def test_what_slips_out_is_held_no_longer() -> None:
    gripper = Gripper(0.08)
    gripper.move(0.0)
    lead(gripper, 1.0, 0.08, obstacle=0.062)
    lead(gripper, 0.05, 0.062, obstacle=0.058)
    assert gripper.state is Grip.MOVING
    lead(gripper, 0.5, 0.058)
    assert gripper.state is Grip.AT_WIDTH


def test_a_halt_keeps_what_is_held_and_stops_what_moves() -> None:
    holding = Gripper(0.06)
    holding.move(0.0)
    lead(holding, 1.0, 0.06, obstacle=0.024)
    holding.halt(0.024)
    assert (holding.state, holding.commanded) == (Grip.HOLDING, 0.0)
    moving = Gripper(0.06)
    moving.move(0.0)
    width = lead(moving, 0.1, 0.06)
    moving.halt(width)
    assert lead(moving, 1.0, width) == width


@given(width=st.floats(-1, 1))
def test_no_width_beyond_the_mechanism_is_asked_of_it(width: float) -> None:
    gripper = Gripper(0.06)
    gripper.move(width)
    assert 0.0 <= gripper.commanded <= WIDEST
