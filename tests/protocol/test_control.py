"""Operator control: one at a time, and never over a stop; and which epochs a controller obeys."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import (
    CommandLong,
    ControlStatus,
    GcsControlStatusFlags,
    MavCmd,
    MavResult,
    Reason,
)
from robotree.protocol.services.command import Request
from robotree.protocol.services.control import PERIOD, ControlChanged, ControlEffect, OperatorControl
from robotree.protocol.services.fence import CLOCK_FROM, CLOCK_SKEW, LAST_EPOCH, LEASES, Fence
from robotree.protocol.services.peer import Peer, Send

ANN, BOB, SELF = Peer("link 1", 255, 190), Peer("link 2", 254, 190), Peer("link 3", 1, 191)
MANAGER = GcsControlStatusFlags.SYSTEM_MANAGER
OPEN = MANAGER | GcsControlStatusFlags.TAKEOVER_ALLOWED


@pytest.fixture
def control() -> OperatorControl:
    control = OperatorControl()
    control.tick(0.0)
    return control


def _request(peer: Peer, *params: float) -> Request:
    return Request(peer, MavCmd.REQUEST_OPERATOR_CONTROL, (*params, *[math.nan] * (7 - len(params))))


def _ask(control: OperatorControl, peer: Peer, now: float, *, takeover: float = 0.0) -> MavResult:
    return control.handle(_request(peer, 1.0, takeover, 10.0, peer.system), now).result


def _statuses(effects: list[ControlEffect]) -> list[tuple[int, int]]:
    return [(each.flags, each.gcs_main) for each in effects if isinstance(each, ControlStatus)]


def test_while_nobody_is_in_control_anyone_may_command(control: OperatorControl) -> None:
    assert control.may(ANN)
    assert control.may(BOB)
    assert control.status == ControlStatus(OPEN, 0)


def test_who_asks_first_gets_it_and_everyone_is_told(control: OperatorControl) -> None:
    assert _ask(control, ANN, 0.1) == MavResult.ACCEPTED
    effects = control.tick(0.1)
    assert effects == [ControlChanged(ANN), ControlStatus(MANAGER, 255)]
    assert control.may(ANN)
    assert not control.may(BOB)
    assert control.tick(0.2) == []


def test_who_claims_to_be_the_robot_itself_is_a_client_like_any_other(control: OperatorControl) -> None:
    _ask(control, ANN, 0.1)
    assert not control.may(SELF)
    assert _ask(control, SELF, 0.2) == MavResult.FAILED


def test_the_status_is_repeated(control: OperatorControl) -> None:
    assert control.tick(PERIOD * 0.9) == []
    assert _statuses(control.tick(PERIOD)) == [(OPEN, 0)]


def test_an_owner_is_told_of_another_ones_wish_and_not_pestered(control: OperatorControl) -> None:
    _ask(control, ANN, 0.0)
    control.tick(0.0)
    assert _ask(control, BOB, 1.0) == MavResult.FAILED
    send, _ = control.tick(1.0)
    assert isinstance(send, Send)
    assert send.via == "link 1"
    wish = send.message
    assert isinstance(wish, CommandLong)
    assert (wish.target_system, wish.param1, wish.param3, wish.param4) == (255, 1.0, 10.0, 254.0)
    assert _ask(control, BOB, 2.0) == MavResult.FAILED
    control.heard(ANN, 2.0)
    assert not any(isinstance(each, Send) for each in control.tick(2.0))
    assert control.owner == ANN


def test_an_owner_who_allows_takeover_loses_it_to_whoever_asks(control: OperatorControl) -> None:
    _ask(control, ANN, 0.0)
    control.tick(0.0)
    assert _ask(control, ANN, 0.5, takeover=1.0) == MavResult.ACCEPTED
    assert control.tick(0.5) == [ControlStatus(OPEN, 255)]
    assert _ask(control, BOB, 0.6) == MavResult.ACCEPTED
    assert control.tick(0.6) == [ControlChanged(BOB), ControlStatus(MANAGER, 254)]


def test_only_the_owner_gives_it_back(control: OperatorControl) -> None:
    _ask(control, ANN, 0.0)
    control.tick(0.0)
    assert control.handle(_request(BOB, 0.0), 0.1).result == MavResult.ACCEPTED
    assert control.owner == ANN
    assert control.handle(_request(ANN, 0.0), 0.2).result == MavResult.ACCEPTED
    assert control.tick(0.2) == [ControlChanged(None), ControlStatus(OPEN, 0)]


def test_an_owner_who_falls_silent_loses_it(control: OperatorControl) -> None:
    _ask(control, ANN, 0.0)
    control.heard(BOB, 2.0)
    control.heard(ANN, 2.0)
    control.tick(4.9)
    assert control.owner == ANN
    assert ControlChanged(None) in control.tick(5.0)
    assert control.owner is None


def test_an_owner_whose_link_ends_loses_it(control: OperatorControl) -> None:
    _ask(control, ANN, 0.0)
    control.tick(0.0)
    control.link_closed("link 2", 0.1)
    assert control.owner == ANN
    control.link_closed("link 1", 0.1)
    assert ControlChanged(None) in control.tick(0.1)


def test_nobody_asks_in_the_name_of_another(control: OperatorControl) -> None:
    assert control.handle(_request(ANN, 1.0, 0.0, 10.0, 77.0), 0.0).result == MavResult.DENIED
    assert control.owner is None


def test_the_same_ids_on_another_link_are_somebody_else(control: OperatorControl) -> None:
    _ask(control, ANN, 0.0)
    assert not control.may(Peer("link 9", 255, 190))


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
