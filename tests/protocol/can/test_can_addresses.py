"""Addresses, identifiers and the words by which nodes agree on a link: all without a bus."""

from __future__ import annotations

import errno
import os
from typing import Never

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.errors import BadUrl, LinkRefused
from robotree.protocol.links.can.address import Telemetry, read
from robotree.protocol.links.can.control import (
    ALIVE_PERIOD,
    SILENCE,
    SILENCE_OF_STRANGERS,
    Code,
    Control,
    SilenceTimer,
)
from robotree.protocol.links.can.control import read as read_control
from robotree.protocol.links.can.identifiers import (
    CONTROLLERS,
    EVERYBODY,
    HOSTS,
    ROUTE,
    Kind,
    Priority,
    identifier,
    route,
    taken_apart,
)
from robotree.protocol.links.can.port import open_port
from robotree.protocol.links.url import parse


def test_an_address_says_where_the_bus_is_and_who_we_are() -> None:
    url = "can:socketcan/can0?node=7&host=130&fd=0&bitrate=500000&silence=1.5&telemetry=addressed"
    address = read(parse(url))
    assert (address.interface, address.channel, address.node, address.host) == ("socketcan", "can0", 7, 130)
    assert (address.silence, address.telemetry) == (1.5, Telemetry.ADDRESSED)
    assert address.bus_options == {"fd": False, "bitrate": 500_000}
    assert str(address) == "can:socketcan/can0?node=7&host=130&fd=0"


def test_what_is_left_out_is_the_usual() -> None:
    address = read(parse("can:robotree/cell"))
    assert (address.node, address.host, address.fd, address.telemetry) == (1, None, True, Telemetry.AUTO)


def test_a_channel_may_be_a_path_and_an_interface_may_have_options_of_its_own() -> None:
    address = read(parse("can:slcan//dev/ttyACM0?data_bitrate=2000000&bus.ttyBaudrate=115200"))
    assert address.channel == "/dev/ttyACM0"
    assert address.bus_options == {"fd": True, "data_bitrate": 2_000_000, "ttyBaudrate": "115200"}


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("can:robotree", "write can:INTERFACE/CHANNEL"),
        ("can:/cell", "write can:INTERFACE/CHANNEL"),
        ("can:robotree/", "write can:INTERFACE/CHANNEL"),
        ("can:robotree/cell?node=0", "node=0 is no whole number from 1 to 127"),
        ("can:robotree/cell?node=128", "from 1 to 127"),
        ("can:robotree/cell?host=1", "from 128 to 254"),
        ("can:robotree/cell?fd=yes", "fd=yes is no whole number from 0 to 1"),
        ("can:robotree/cell?silence=0", "silence=0 is no time"),
        ("can:robotree/cell?silence=nan", "silence=nan is no time"),
        ("can:robotree/cell?silence=long", "silence=long is no time"),
        ("can:robotree/cell?telemetry=some", "none of auto, broadcast, addressed"),
        ("can:robotree/cell?baud=5", "option 'baud' is unknown"),
    ],
)
def test_an_address_that_means_nothing_is_refused_in_one_sentence(url: str, sentence: str) -> None:
    with pytest.raises(BadUrl, match=sentence):
        read(parse(url))


def test_identifiers_are_those_of_normal_fixed_addressing() -> None:
    assert identifier(Priority(2), Kind.ADDRESSED, target=0x01, source=0x80) == 0x08DA0180
    assert identifier(Priority(5), Kind.BROADCAST, target=EVERYBODY, source=0x01) == 0x14DBFF01
    assert identifier(Priority(2), Kind.CONTROL, target=0x80, source=0x7F) == 0x08EF807F


NODES = st.integers(0, 255)


@given(priority=st.sampled_from(Priority), kind=st.sampled_from(Kind), target=NODES, source=NODES)
def test_identifiers_can_be_taken_apart(priority: Priority, kind: Kind, target: int, source: int) -> None:
    whole = identifier(priority, kind, target=target, source=source)
    assert 0 <= whole < 1 << 29
    assert taken_apart(whole) == (kind, target, source)
    assert whole & ROUTE == route(kind, target=target, source=source)
    assert whole >> 26 == priority


def test_no_two_nodes_ever_send_the_same_identifier() -> None:
    """The source is part of it, and controllers and hosts have no numbers in common."""
    assert not set(CONTROLLERS) & set(HOSTS)
    assert EVERYBODY not in {*CONTROLLERS, *HOSTS}


@given(code=st.sampled_from(Code), session=st.integers(0, 2**32 - 1), padding=st.binary(max_size=58))
def test_control_frames_are_understood_with_padding_behind_them(
    code: Code, session: int, padding: bytes
) -> None:
    control = Control(code, session)
    assert len(control.encode()) <= 8
    assert read_control(control.encode() + padding) == control


@given(field=st.binary(max_size=64))
def test_no_bytes_raise_as_control_frames(field: bytes) -> None:
    control = read_control(field)
    assert control is None or field.startswith(control.encode())


def test_a_partner_is_told_that_we_live_once_per_period() -> None:
    presence = SilenceTimer(0.0, session=9)
    assert presence.due == pytest.approx(ALIVE_PERIOD)
    assert presence.tick(ALIVE_PERIOD / 2) is None
    assert presence.tick(ALIVE_PERIOD) == Control(Code.ALIVE, 9)
    assert presence.tick(ALIVE_PERIOD) is None


@pytest.mark.parametrize(("session", "silence"), [(9, SILENCE), (None, SILENCE_OF_STRANGERS)])
def test_a_silent_partner_has_gone(session: int | None, silence: float) -> None:
    presence = SilenceTimer(0.0, session)
    assert not presence.gone(silence - 0.01)
    assert presence.gone(silence)
    presence.heard = 1.0
    assert not presence.gone(silence)


def test_a_partner_without_sessions_gets_no_control_frames() -> None:
    presence = SilenceTimer(0.0, None)
    assert presence.tick(10.0) is None
    assert presence.due == pytest.approx(SILENCE_OF_STRANGERS)


@pytest.mark.parametrize(
    ("url", "number", "sentence"),
    [
        (
            "can:socketcan/can0",
            errno.EAFNOSUPPORT,
            "kernel has no CAN; load it .* or use can:robotree/CHANNEL",
        ),
        ("can:socketcan/can7", errno.ENODEV, "no interface can7; plug in its adapter"),
        ("can:socketcan/can7", errno.ENETDOWN, "can7 is down; bring it up .ip link set can7 up"),
        ("can:socketcan/can0", errno.EPERM, "Operation not permitted"),
        ("can:slcan//dev/ttyS9", errno.ENODEV, "No such device"),
    ],
)
async def test_a_bus_that_cannot_be_had_says_whose_fault_it_is_and_what_to_do(
    monkeypatch: pytest.MonkeyPatch, url: str, number: int, sentence: str
) -> None:
    def refuse(**_: object) -> Never:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(can, "Bus", refuse)
    with pytest.raises(LinkRefused, match=sentence):
        await open_port(read(parse(url)))
