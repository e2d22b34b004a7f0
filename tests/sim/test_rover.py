"""The rover ends where it was sent, or says why not; limits hold for what the wire can carry."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol.messages import GoalState, LocalPositionNed, Reason, Verb
from robotree.sim.errors import BadArgument
from robotree.sim.firmware.device import require
from robotree.sim.rover.device import ARENA
from robotree.sim.testing import NAN, RoverBench


def place(rover: RoverBench) -> tuple[float, float]:
    x, y = rover.world.rover.state().position.tolist()
    return x, y


@given(x=st.floats(-1.4, 1.4), y=st.floats(-0.4, 0.8), speed=st.floats(0.05, 1.0))
@settings(max_examples=6, deadline=None)
def test_a_move_ends_within_five_millimetres(x: float, y: float, speed: float) -> None:
    rover = RoverBench()
    rover.operator.succeed(Verb.MOVE, x, y, speed)
    assert math.dist(place(rover), (x, y)) < 0.005


def test_a_square_ends_where_it_began(rover: RoverBench) -> None:
    """The thesis' MoveSquare, eight inches to a side."""
    side = 8 * 0.0254
    for dx, dy in ((side, 0), (0, side), (-side, 0), (0, -side)):
        rover.operator.succeed(Verb.MOVE, dx, dy)
    assert math.dist(place(rover), (0, 0)) < 0.005


def test_the_errors_of_many_moves_do_not_add_up(rover: RoverBench) -> None:
    for _ in range(20):
        rover.operator.succeed(Verb.MOVE, 0.05, 0.02)
    assert math.dist(place(rover), (1.0, 0.4)) < 0.005


def test_the_wire_tells_the_place_north_east_down(rover: RoverBench) -> None:
    rover.operator.succeed(Verb.MOVE, 0.3, 0.2)
    rover.operator.wait(1.0)
    told = rover.operator.latest(LocalPositionNed)
    np.testing.assert_allclose((told.x, told.y, told.z), (0.3, -0.2, 0.0), atol=0.005)


def test_a_crate_in_the_way_ends_the_move_as_blocked(rover: RoverBench) -> None:
    rover.operator.succeed(Verb.MOVE, 0.8, 0.0)
    status = rover.operator.do(Verb.MOVE, 0.0, -1.2)
    assert (status.state, status.reason) == (GoalState.FAILED, Reason.BLOCKED)
    blocked_at = place(rover)
    rover.operator.succeed(Verb.MOVE, 0.0, 0.5)
    assert math.dist(place(rover), (blocked_at[0], blocked_at[1] + 0.5)) < 0.01, (
        "it goes on from where it stood"
    )


@pytest.mark.parametrize(
    ("args", "reason"),
    [
        ((NAN, 0.1), Reason.BAD_ARGUMENT),
        ((math.inf, 0.1), Reason.BAD_ARGUMENT),
        ((0.1, 0.1, 0.0), Reason.BAD_ARGUMENT),
        ((0.1, 0.1, 99.0), Reason.BAD_ARGUMENT),
        ((ARENA + 0.01, 0.0), Reason.OUT_OF_REACH),
        ((0.0, -1e30), Reason.OUT_OF_REACH),
    ],
)
def test_nonsense_is_refused_and_nothing_moves(
    rover: RoverBench, args: tuple[float, ...], reason: Reason
) -> None:
    status = rover.operator.do(Verb.MOVE, *args)
    assert (status.state, status.reason) == (GoalState.REFUSED, reason)
    assert status.text
    rover.operator.wait(0.5)
    assert math.dist(place(rover), (0, 0)) < 1e-6


def test_a_verb_of_another_robot_is_unknown_here(rover: RoverBench) -> None:
    status = rover.operator.do(Verb.GRIP, 0.04)
    assert (status.state, status.reason) == (GoalState.REFUSED, Reason.UNKNOWN_VERB)


def on_the_wire(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


@given(limit=st.floats(1e-3, 1e3))
def test_a_limit_itself_is_allowed_though_the_wire_rounds_it(limit: float) -> None:
    require("speed", on_the_wire(limit), limit, 2 * limit, "m/s")
    require("speed", on_the_wire(limit), limit / 2, limit, "m/s")
    with pytest.raises(BadArgument):
        require("speed", on_the_wire(limit), 2 * limit, 3 * limit, "m/s")


@given(limit=st.floats(1e-3, 1e3), beyond=st.floats(1e-5, 1.0))
def test_what_is_beyond_is_refused(limit: float, beyond: float) -> None:
    with pytest.raises(BadArgument):
        require("speed", limit * (1 + beyond), 0.0, limit, "m/s")


def test_nan_is_no_number_within_limits() -> None:
    with pytest.raises(BadArgument):
        require("speed", float("nan"), 0.0, 1.0, "m/s")
