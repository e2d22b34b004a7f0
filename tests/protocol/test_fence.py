"""Which epochs a controller obeys."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import Reason
from robotree.protocol.services.fence import CLOCK_FROM, CLOCK_SKEW, LAST_EPOCH, LEASES, Fence

NOW = CLOCK_FROM + 10**7
epochs = st.integers(0, 2**32 - 1)


@given(obeyed=st.integers(0, LAST_EPOCH), asked=st.lists(epochs, max_size=20))
def test_it_never_falls_and_never_passes_the_last_one(obeyed: int, asked: list[int]) -> None:
    fence = Fence(obeyed)
    for epoch in asked:
        before = fence.epoch
        admitted = fence.admit(epoch) is None
        assert fence.epoch == (epoch if admitted else before)
        assert before <= fence.epoch <= LAST_EPOCH


@given(obeyed=st.integers(0, LAST_EPOCH - 1), clock=st.sampled_from([0.0, float(NOW)]))
def test_whatever_was_obeyed_the_next_epoch_above_it_is(obeyed: int, clock: float) -> None:
    assert Fence(obeyed, clock=lambda: clock).admit(obeyed + 1) is None


@given(clock=st.sampled_from([0.0, 1000.0, float(NOW)]), forged=epochs)
def test_one_forged_epoch_leaves_room_for_a_million_leases_and_more(clock: float, forged: int) -> None:
    fence = Fence(clock=lambda: clock)
    fence.admit(forged)
    assert LAST_EPOCH - fence.epoch > LEASES


def test_with_a_clock_nothing_from_after_tomorrow_is_obeyed() -> None:
    fence = Fence(clock=lambda: float(NOW))
    refusal = fence.admit(NOW + CLOCK_SKEW + 1)
    assert refusal is not None
    assert refusal[0] == Reason.BAD_EPOCH
    assert len(refusal[1].encode()) <= 80, "as much as GOAL_STATUS can say"
    assert fence.admit(NOW + 3600) is None
    assert fence.admit(NOW + 3600 + LEASES) is None, "who counts on may be ahead of the clock"


@pytest.mark.parametrize("epoch", [2**32 - 1, LAST_EPOCH + 1, LAST_EPOCH])
def test_near_the_end_is_no_honest_epoch_on_a_fresh_controller(epoch: int) -> None:
    assert Fence().admit(epoch) is not None


def test_each_change_is_kept_and_no_repetition() -> None:
    kept: list[tuple[int, int]] = []
    fence = Fence(keep=lambda it: kept.append((it.epoch, it.holder)))
    assert [fence.admit(5) for _ in range(2)] == [None, None], "it is obeyed until there is a larger one"
    fence.grant(6, 77, "arm-1")
    fence.grant(6, 77, "arm-1")
    assert fence.admit(4) is not None
    assert kept == [(5, 0), (6, 77)]
