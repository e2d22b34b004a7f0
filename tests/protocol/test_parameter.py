"""Parameters: every question is answered, also when the answer is no."""

from __future__ import annotations

import math

import pytest

from robotree.protocol import Frame
from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages import (
    MavParamError,
    MavParamType,
    ParamError,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
)
from robotree.protocol.services.parameter import (
    MAX_PEERS,
    PACE,
    Changed,
    Parameter,
    ParameterEffect,
    ParameterServer,
)
from robotree.protocol.services.peer import Peer, Send

PEER, OTHER = Peer("link 1", 255, 190), Peer("link 2", 255, 190)


@pytest.fixture
def server() -> ParameterServer:
    return ParameterServer(
        [
            Parameter(name="ADM_MASS", value=2.5, lower=0.1, upper=10.0, text="Virtual mass [kg]."),
            Parameter(name="EXACTLY_SIXTEEN_", value=0.1, lower=0.1, upper=0.3),
        ],
        may_set=lambda peer: peer == PEER,
    )


def _one(effects: list[ParameterEffect]) -> object:
    (send,) = effects
    assert isinstance(send, Send)
    return Frame.of(send.message).message


def _set(name: str, value: float, kind: int = MavParamType.REAL32) -> ParamSet:
    return ParamSet(1, 1, name, value, kind)


def test_a_parameter_is_told_by_name_and_by_index(server: ParameterServer) -> None:
    by_name = server.receive(ParamRequestRead(1, 1, "ADM_MASS", -1), PEER, 0.0)
    assert _one(by_name) == ParamValue("ADM_MASS", 2.5, MavParamType.REAL32, 2, 0)
    assert server.receive(ParamRequestRead(1, 1, "", 0), PEER, 0.0) == by_name
    long = _one(server.receive(ParamRequestRead(1, 1, "EXACTLY_SIXTEEN_", -1), OTHER, 0.0))
    assert isinstance(long, ParamValue)
    assert long.param_id == "EXACTLY_SIXTEEN_"
    assert server["ADM_MASS"] == 2.5


def test_a_set_parameter_is_told_again(server: ParameterServer) -> None:
    changed, told = server.receive(_set("ADM_MASS", 4.0), PEER, 0.0)
    assert changed == Changed("ADM_MASS", 4.0)
    assert told == Send(ParamValue("ADM_MASS", 4.0, MavParamType.REAL32, 2, 0), "link 1")
    assert server["ADM_MASS"] == 4.0


@pytest.mark.parametrize(
    ("message", "peer", "error"),
    [
        (_set("NOBODY", 1.0), PEER, MavParamError.DOES_NOT_EXIST),
        (_set("ADM_MASS", 10.01), PEER, MavParamError.VALUE_OUT_OF_RANGE),
        (_set("ADM_MASS", -1.0), PEER, MavParamError.VALUE_OUT_OF_RANGE),
        (_set("ADM_MASS", math.nan), PEER, MavParamError.VALUE_OUT_OF_RANGE),
        (_set("ADM_MASS", math.inf), PEER, MavParamError.VALUE_OUT_OF_RANGE),
        (_set("ADM_MASS", 3.0, kind=6), PEER, MavParamError.TYPE_MISMATCH),
        (_set("ADM_MASS", 3.0), OTHER, MavParamError.PERMISSION_DENIED),
        (ParamRequestRead(1, 1, "NOBODY", -1), PEER, MavParamError.DOES_NOT_EXIST),
        (ParamRequestRead(1, 1, "", 3), PEER, MavParamError.DOES_NOT_EXIST),
    ],
)
def test_what_cannot_be_done_is_said_at_once(
    server: ParameterServer, message: ParamSet | ParamRequestRead, peer: Peer, error: MavParamError
) -> None:
    effects = server.receive(message, peer, 0.0)
    answer = _one(effects[:1])
    assert isinstance(answer, ParamError)
    assert answer.error == error
    assert (answer.target_system, answer.target_component) == (255, 190)
    assert server["ADM_MASS"] == 2.5
    known = isinstance(message, ParamSet) and error != MavParamError.DOES_NOT_EXIST
    # Tools that know no PARAM_ERROR look for the value.
    assert effects[1:] == ([Send(server.value_message(message.param_id), peer.via)] if known else [])


def test_a_bound_is_reached_although_the_wire_rounds_it(server: ParameterServer) -> None:
    frame = Frame.of(_set("EXACTLY_SIXTEEN_", 0.3))
    assert isinstance(frame.message, ParamSet)
    assert frame.message.param_value > 0.3
    assert server.receive(frame.message, PEER, 0.0)[0] == Changed("EXACTLY_SIXTEEN_", 0.3)


def test_a_list_is_sent_at_its_pace_to_whoever_asked(server: ParameterServer) -> None:
    effects = server.receive(ParamRequestList(1, 1), PEER, 0.0)
    assert len(effects) == 1
    assert server.tick(PACE * 0.9) == []
    assert server.receive(ParamRequestList(1, 1), OTHER, PACE * 0.95) == []
    sends = [*effects, *(each for i in range(1, 10) for each in server.tick(PACE * i))]
    told = [(each.via, each.message.param_index) for each in sends if isinstance(each.message, ParamValue)]  # type: ignore[union-attr]  # all are Sends
    assert [index for via, index in told if via == "link 1"] == [0, 1]
    assert [index for via, index in told if via == "link 2"] == [0, 1]
    assert server.tick(9.0) == []


def test_lists_end_with_their_link_and_do_not_pile_up(server: ParameterServer) -> None:
    for i in range(MAX_PEERS + 9):
        server.receive(ParamRequestList(1, 1), Peer(f"link {i}", 1, 1), 0.0)
    assert len(server._lists) == MAX_PEERS
    server.link_closed("link 0")
    assert len(server._lists) == MAX_PEERS - 1


def test_an_empty_list_says_nothing() -> None:
    server = ParameterServer([])
    assert server.receive(ParamRequestList(1, 1), PEER, 0.0) == []
    assert server.tick(1.0) == []


@pytest.mark.parametrize(
    ("name", "value"), [("", 0.0), ("SEVENTEEN_LETTERS", 0.0), ("X", 2.0), ("X", math.nan)]
)
def test_a_parameter_that_does_not_fit_is_refused_at_birth(name: str, value: float) -> None:
    with pytest.raises(InvalidMessage, match="PARAM_VALUE"):
        Parameter(name=name, value=value, lower=0.0, upper=1.0)
