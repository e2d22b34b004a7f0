"""PING, and what we say when we are asked what we are."""

from __future__ import annotations

import pytest

from robotree.protocol import Frame
from robotree.protocol.messages import MavProtocolCapability, Ping
from robotree.protocol.services import ping
from robotree.protocol.services.peer import Peer
from robotree.protocol.services.version import autopilot_version, packed, protocol_version

ARM, ROVER, US = Peer("link", 1, 1), Peer("link", 2, 1), Peer("link", 255, 190)


def test_everyone_who_hears_a_ping_answers_it_and_every_answer_is_measured() -> None:
    pinger = ping.Pinger(255, 190)
    question = pinger.ask(5.0)
    (answer,) = ping.answer(question, US)
    assert ping.answer(answer, ARM) == []
    assert pinger.receive(answer, ARM, 5.25) == ping.PingAnswer(1, 0.25, 1, 1)
    assert pinger.receive(answer, ROVER, 5.5) == ping.PingAnswer(1, 0.5, 2, 1)
    assert pinger.tick(20.0) == []
    assert pinger.receive(answer, ARM, 20.0) is None


def test_questions_without_an_answer_are_counted_and_forgotten() -> None:
    pinger = ping.Pinger(255, 190)
    for i in range(3):
        pinger.ask(float(i))
    assert pinger.tick(ping.LOST_AFTER + 1.0) == [1, 2]
    assert pinger.lost == 2
    assert pinger.receive(Ping(0, 3, 254, 190), ARM, 2.5) is None, "an answer to somebody else"
    assert pinger.receive(Ping(0, 9, 255, 190), ARM, 2.5) is None, "an answer to nothing"


@pytest.mark.parametrize(
    ("version", "wire"),
    [
        ("1.2.3", 0x010203FF),
        ("0.1.0", 0x000100FF),
        ("2.0rc1", 0x020000C0),
        ("2.0.1b3", 0x02000180),
        ("300.1", 0xFF0100FF),
        ("1.0.0.dev5", 0x01000000),
        ("unknown", 0),
    ],
)
def test_a_version_is_packed_into_four_bytes(version: str, wire: int) -> None:
    assert packed(version) == wire


def test_we_offer_real_numbers_as_parameters_and_speak_version_2() -> None:
    told = Frame.of(autopilot_version("1.2.3", uid=7)).message
    assert told == autopilot_version("1.2.3", uid=7)
    capabilities = autopilot_version("1.2.3", uid=7).capabilities
    assert capabilities & MavProtocolCapability.MAVLINK2
    assert capabilities & MavProtocolCapability.PARAM_ENCODE_C_CAST
    assert Frame.of(protocol_version()).message == protocol_version()
    assert protocol_version().version == 200
