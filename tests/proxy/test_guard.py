"""Laws of the guard before the wire."""

import math
from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.proxy import arm, rover
from robotree.proxy.arm import GoTo, Grip
from robotree.proxy.guard import NO_LIMITS, EpochCheck, Span, changed, check
from robotree.proxy.motion import Hold, Motion
from robotree.proxy.rover import Move, check_arrival
from robotree.vr.base.errors import BadArgument, StaleEpoch

anything = st.floats(allow_nan=True, allow_infinity=True)
near = st.floats(-1, 1)
value = anything | near
arm_motions: st.SearchStrategy[Motion] = st.one_of(
    st.builds(GoTo, x=value, y=value, z=value, twist=value, speed=value),
    st.builds(Grip, width=value),
    st.just(Hold()),
)


@given(motion=arm_motions)
def test_what_passes_the_guard_is_within_every_limit(motion: Motion) -> None:
    limits = arm.LIMITS
    within = all(limits[name].lower <= v <= limits[name].upper for name, v in asdict(motion).items())
    try:
        check(motion, limits, command="c")
    except BadArgument:
        assert not within
    else:
        assert within


@given(dx=value, dy=value, speed=value, x=near, y=near)
def test_no_move_leads_out_of_the_arena(dx: float, dy: float, speed: float, x: float, y: float) -> None:
    motion, limits = Move(x=dx, y=dy, speed=speed), rover.LIMITS
    try:
        check(motion, limits, command="move")
        check_arrival(motion, (x, y), limits, command="move")
    except BadArgument:
        return
    assert abs(x + dx) <= limits["arena_x"].upper
    assert abs(y + dy) <= limits["arena_y"].upper


def test_a_refusal_names_value_limit_and_unit() -> None:
    with pytest.raises(BadArgument, match=r"go_to: z: -0\.1 m is outside 0\.025 to 0\.8 m"):
        check(GoTo(x=0.3, y=0, z=-0.1, twist=0, speed=0.1), arm.LIMITS, command="go_to")
    with pytest.raises(BadArgument, match=r"is not a number; give one from 0 to 0\.08 m"):
        check(Grip(width=math.nan), arm.LIMITS, command="grip")
    with pytest.raises(BadArgument, match=r"y: the move would end at 1\.900 m, the arena is -1\.5 to 1\.5 m"):
        check_arrival(Move(x=0, y=0.9, speed=0.3), (0.0, 1.0), rover.LIMITS, command="move")


def test_a_value_without_a_known_limit_is_not_sent() -> None:
    with pytest.raises(BadArgument, match="no limit"):
        check(Grip(width=0.01), rover.LIMITS, command="grip")


def test_another_place_has_another_box() -> None:
    narrow = changed(arm.LIMITS, {"x": Span(0.2, 0.4, "m")})
    with pytest.raises(BadArgument, match=r"0\.5 m is outside 0\.2 to 0\.4 m"):
        check(GoTo(x=0.5, y=0, z=0.2, twist=0, speed=0.1), narrow, command="go_to")


def test_a_change_of_a_limit_that_a_kind_does_not_have_is_a_mistake() -> None:
    with pytest.raises(
        ValueError, match="there is no limit widht; there is: x, y, z, twist, speed, blend, width"
    ):
        changed(arm.LIMITS, {"widht": Span(0.0, 0.04, "m")})


def test_of_a_robot_without_limits_nothing_is_asked_that_has_a_number() -> None:
    check(Hold(), NO_LIMITS, command="hold")
    with pytest.raises(BadArgument, match="no limit"):
        check(Grip(width=0.01), NO_LIMITS, command="grip")


@given(lower=value, upper=value)
def test_a_span_that_limits_nothing_is_not_born(lower: float, upper: float) -> None:
    try:
        span = Span(lower, upper, "m")
    except ValueError:
        assert not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper)
    else:
        assert lower in span
        assert upper in span
        assert (lower + math.nan) not in span


@given(epochs=st.lists(st.integers(0, 2**32 - 1)))
def test_epochs_that_pass_never_fall(epochs: list[int]) -> None:
    fence, passed = EpochCheck("arm-1"), [0]
    for epoch in epochs:
        try:
            fence.admit(epoch)
        except StaleEpoch:
            assert epoch < passed[-1]
        else:
            passed.append(epoch)
    assert passed == sorted(passed)


def test_an_epoch_that_the_controller_has_seen_counts_too() -> None:
    fence = EpochCheck("arm-1")
    fence.raise_to(8)
    with pytest.raises(StaleEpoch, match="no longer obeys epoch 7, it is at 8"):
        fence.admit(7)
    fence.admit(8)
