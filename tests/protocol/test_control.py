"""Operator control: one at a time, and never over a stop."""

from __future__ import annotations

import math

import pytest

from robotree.protocol.messages import (
    CommandLong,
    ControlStatus,
    GcsControlStatusFlags,
    MavCmd,
    MavResult,
)
from robotree.protocol.services.command import Request
from robotree.protocol.services.control import PERIOD, ControlChanged, ControlEffect, OperatorControl
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
