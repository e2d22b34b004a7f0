"""The loopback bus: what python-can promises, who comes finds everybody, and records survive the way."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import pairwise

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.canbus import LoopbackBus, channel_id, first_port, membership
from robotree.protocol.canbus.membership import GLANCE, HOST, SEATS, STALLED_AFTER, Wire
from robotree.protocol.canbus.records import (
    GREETING_BYTES,
    LARGEST_RECORD,
    Greeting,
    Records,
    encode,
    read_greeting,
)
from tests.waiting import wait_until

Buses = Callable[..., LoopbackBus]
SOON = 60.0
"""[s] A frame that has not come by then will not come."""


def test_a_frame_reaches_everybody_but_its_sender(buses: Buses) -> None:
    one, two, three = buses(), buses(), buses()
    before = time.time()
    one.send(can.Message(arbitration_id=0x18DA0180, data=bytes(60), is_fd=True, bitrate_switch=True))
    for bus in (two, three):
        message = bus.recv(SOON)
        assert message is not None
        assert (message.arbitration_id, message.dlc, message.is_fd) == (0x18DA0180, 60, True)
        assert before <= message.timestamp <= time.time()
        assert message.is_rx
    assert one.recv(0) is None


def test_own_frames_come_back_when_asked_for(buses: Buses) -> None:
    one, two = buses(receive_own_messages=True), buses()
    sent = can.Message(arbitration_id=7, data=b"mine")
    one.send(sent)
    echo = one.recv(SOON)
    assert echo is not None
    assert (echo.arbitration_id, echo.data, echo.is_rx) == (7, b"mine", False)
    assert echo.timestamp > 0
    assert sent.timestamp == 0, "the caller's message is the caller's"
    assert two.recv(SOON)
    assert one.recv(0.01) is None


def test_all_comes_in_order_to_a_reader_that_is_slower_than_the_sender(buses: Buses) -> None:
    one, two = buses(), buses()
    message, total, got = can.Message(data=bytes(64), is_fd=True), 20_000, []

    def read() -> None:
        while len(got) < total and (came := two.recv(SOON)) is not None:
            got.append(came)

    reader = threading.Thread(target=read)
    reader.start()
    for index in range(total):
        message.arbitration_id = index
        one.send(message)
    reader.join()
    assert [came.arbitration_id for came in got] == list(range(total))
    assert one.statistics.dropped == 0


def test_a_member_that_reads_nothing_holds_nobody_up(buses: Buses) -> None:
    one, _sleeper, reader = buses(), buses(), buses()
    message, total = can.Message(data=bytes(64), is_fd=True), 40_000
    heard = threading.Thread(target=lambda: [reader.recv(SOON) for _ in range(total)])
    heard.start()
    for _ in range(total):
        one.send(message)
    heard.join()
    assert reader.statistics.received == total
    assert 0 < one.statistics.dropped < total


def test_time_in_which_nobody_looked_makes_no_reader_stalled() -> None:
    with socket.create_server((HOST, 0)) as door, socket.create_connection(door.getsockname()) as connection:
        wire, now = Wire(connection, 1, "any"), 100.0
        while not wire.full:
            wire.put(bytes(1000), now)
        wire.flush(now)
        wire.flush(now + 60.0)  # the system gives us the processor again
        assert not wire.stalled
        for look in range(1, round(STALLED_AFTER / GLANCE) + 2):
            wire.flush(now + 60.0 + look * GLANCE)
        assert wire.stalled, "who reads nothing while we look is stalled"


def test_a_sender_that_will_not_wait_is_told_so(buses: Buses) -> None:
    one, sleeper = buses(), buses()
    message = can.Message(data=bytes(64), is_fd=True)

    def send_for_ever() -> None:
        while True:
            one.send(message, timeout=0)

    with pytest.raises(can.CanTimeoutError, match="no room"):
        send_for_ever()
    assert all(sleeper.recv(SOON) for _ in range(one.statistics.sent)), "all others arrived"
    assert sleeper.recv(0.02) is None, "a frame that was refused went to nobody"


def test_filters_choose_what_is_handed_out(buses: Buses) -> None:
    one = buses()
    two = buses(can_filters=[{"can_id": 0x100, "can_mask": 0x700, "extended": False}])
    for identifier in (0x0FF, 0x123, 0x200, 0x1FF):
        one.send(can.Message(arbitration_id=identifier, is_extended_id=False))
    arrived = [two.recv(SOON), two.recv(SOON)]
    assert [message.arbitration_id for message in arrived if message] == [0x123, 0x1FF]
    assert two.recv(0.01) is None


def test_classic_members_see_no_can_fd(buses: Buses) -> None:
    modern, classic = buses(), buses(fd=False)
    assert classic.protocol is can.CanProtocol.CAN_20
    modern.send(can.Message(data=bytes(12), is_fd=True))
    modern.send(can.Message(data=b"plain"))
    message = classic.recv(SOON)
    assert message is not None
    assert message.data == b"plain"
    assert classic.statistics.incompatible == 1
    with pytest.raises(can.CanOperationError, match="fd=True"):
        classic.send(can.Message(is_fd=True))


def test_a_passive_member_listens_and_says_nothing(buses: Buses) -> None:
    one, monitor = buses(), buses()
    monitor.state = can.BusState.PASSIVE
    with pytest.raises(can.CanOperationError, match="passive"):
        monitor.send(can.Message())
    one.send(can.Message(arbitration_id=3))
    assert monitor.recv(SOON)
    monitor.state = can.BusState.ACTIVE
    monitor.send(can.Message())
    with pytest.raises(ValueError, match="ERROR"):
        monitor.state = can.BusState.ERROR


def test_waiting_ends_in_time(buses: Buses) -> None:
    bus = buses()
    begun = time.monotonic()
    assert bus.recv(0.05) is None
    assert 0.04 <= time.monotonic() - begun < SOON
    assert bus.recv(0) is None


def test_the_descriptor_is_readable_exactly_while_there_is_something(buses: Buses) -> None:
    one, two = buses(), buses(receive_own_messages=True)
    poll = select.poll()
    poll.register(two.fileno(), select.POLLIN)
    assert poll.poll(0) == []
    for index in range(3):
        one.send(can.Message(arbitration_id=index))
    two.send(can.Message(arbitration_id=3))
    for _ in range(4):
        assert poll.poll(SOON * 1000)
        assert two.recv(0)
    assert poll.poll(0) == []


async def test_python_cans_notifier_hears_everything_in_an_event_loop(buses: Buses) -> None:
    one, two = buses(), buses()
    reader = can.AsyncBufferedReader()
    with can.Notifier(two, [reader], loop=asyncio.get_running_loop()):
        for index in range(50):
            one.send(can.Message(arbitration_id=index))
        arrived = [await asyncio.wait_for(reader.get_message(), SOON) for _ in range(50)]
    assert [message.arbitration_id for message in arrived] == list(range(50))


def test_two_names_that_share_a_row_of_ports_are_separate_channels() -> None:
    names = ("bus 0", "bus 20")
    assert len({first_port(name) for name in names}) == 1
    with LoopbackBus(names[0]) as one, LoopbackBus(names[1]) as other, LoopbackBus(names[0]) as third:
        one.send(can.Message())
        assert third.recv(SOON)
        assert other.recv(0.02) is None
        assert other.statistics.members == 0


def test_rows_of_ports_that_overlap_are_separate_channels_too() -> None:
    port = first_port("overlap")
    with LoopbackBus(port) as one, LoopbackBus(port + 1) as other, LoopbackBus(port) as third:
        one.send(can.Message())
        assert third.recv(SOON)
        assert other.recv(0.02) is None
        assert other.statistics.members == 0


def greeted(channel: str, *, token: int = 42) -> socket.socket:
    """A connection that has introduced itself to the first member, as a member would."""
    connection = socket.create_connection((HOST, first_port(channel)))
    connection.sendall(Greeting(answer=False, channel=channel_id(channel), token=token).encode())
    assert connection.recv(100)
    return connection


def test_a_member_with_two_connections_hears_everything_once(buses: Buses, channel: str) -> None:
    """As after two members have joined at the same moment; when one connection ends, the other takes over."""
    bus = buses()
    message = can.Message(arbitration_id=1, data=b"once")
    with greeted(channel, token=7) as first, greeted(channel, token=7) as second:
        assert bus.statistics.members == 1
        bus.send(message)
        assert len(first.recv(100)) == 20
        second.settimeout(0.05)
        with pytest.raises(TimeoutError):
            second.recv(100)
        first.close()
        assert bus.recv(0.1) is None
        bus.send(message)
        assert len(second.recv(100)) == 20


def test_strangers_are_shown_the_door_and_counted(buses: Buses, channel: str) -> None:
    bus, other = buses(), buses()
    with socket.create_connection((HOST, first_port(channel))) as pending:
        pending.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        with suppress(ConnectionResetError):
            assert pending.recv(100) == b"", "it is cut without a word"
    assert bus.statistics.malformed == 1
    other.send(can.Message())
    assert bus.recv(SOON)


def test_a_member_that_speaks_nonsense_is_cut_off_and_counted(buses: Buses, channel: str) -> None:
    bus, other = buses(), buses()
    with greeted(channel) as mad:
        assert bus.statistics.members == 2
        mad.sendall(b"\x00" * 100)
        assert bus.recv(0.2) is None
        with suppress(ConnectionResetError):
            assert mad.recv(100) == b""
    assert bus.statistics.malformed == 1
    assert bus.statistics.members == 1
    other.send(can.Message())
    assert bus.recv(SOON)


def test_a_crowd_of_silent_strangers_keeps_nobody_out(buses: Buses, channel: str) -> None:
    bus = buses()
    with ExitStack() as crowd:
        for _ in range(200):
            crowd.enter_context(socket.create_connection((HOST, first_port(channel))))
        other = buses()
        wait_until(lambda: other.statistics.members)  # a busy member answers later than a newcomer waits
        other.send(can.Message())
        assert bus.recv(SOON)


def test_of_a_crowd_that_is_cut_off_those_who_introduced_themselves_stay(channel: str) -> None:
    """All come at once: the greeting of the first one waits unread while the last ones come."""
    with LoopbackBus(channel) as bus, ExitStack() as crowd, bus._membership.lock:
        first = crowd.enter_context(socket.create_connection((HOST, first_port(channel))))
        first.sendall(Greeting(answer=False, channel=channel_id(channel), token=42).encode())
        for _ in range(100):
            crowd.enter_context(socket.create_connection((HOST, first_port(channel))))
        bus._membership.lock.wait_for(lambda: bus._membership.outlets, SOON)
        assert bus.statistics.members == 1


def test_a_foreign_server_on_a_seat_is_no_member(channel: str) -> None:
    with socket.create_server((HOST, first_port(channel) + 1)) as foreign:
        one = LoopbackBus(channel)
        foreign.settimeout(SOON)
        connection, _ = foreign.accept()
        connection.sendall(b"220 smtp.example.org ready\r\n")
        with LoopbackBus(channel) as two:
            two.send(can.Message())
            assert one.recv(SOON)
        connection.close()
        assert one.statistics.malformed == 1
        one.shutdown()


def test_python_can_finds_the_interface_by_its_name(channel: str) -> None:
    with can.Bus(interface="robotree", channel=channel, bitrate=500_000, data_bitrate=2_000_000) as bus:
        assert isinstance(bus, LoopbackBus)
        assert channel in str(bus)
    assert {"interface": "robotree", "channel": "robotree"} in can.detect_available_configs("robotree")


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    """Every kind of frame that python-can can describe."""
    extended = draw(st.booleans())
    kind = draw(st.sampled_from(["data", "remote", "error", "fd"]))
    fd = kind == "fd"
    return can.Message(
        arbitration_id=draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
        is_extended_id=extended,
        is_remote_frame=kind == "remote",
        is_error_frame=kind == "error",
        is_fd=fd,
        bitrate_switch=fd and draw(st.booleans()),
        error_state_indicator=fd and draw(st.booleans()),
        dlc=draw(st.integers(0, 8)) if kind == "remote" else None,
        data=None if kind == "remote" else draw(st.binary(max_size=64 if fd else 8)),
        check=True,
    )


@given(sent=st.lists(messages(), max_size=5), cuts=st.lists(st.integers(0, 400)))
def test_frames_survive_being_cut_anywhere(sent: list[can.Message], cuts: list[int]) -> None:
    stream = b"".join(encode(message, timestamp=1.5) for message in sent)
    records, arrived, position = Records("cell"), [], 0
    for cut in [*sorted(cuts), len(stream)]:
        arrived += records.feed(stream[position:cut])
        position = max(position, cut)
    assert records.intact
    assert len(arrived) == len(sent)
    for one, other in zip(arrived, sent, strict=True):
        assert one.equals(other, timestamp_delta=None, check_channel=False)
        assert (one.timestamp, one.channel, one.is_rx) == (1.5, "cell", True)


@given(message=messages())
def test_a_record_is_never_longer_than_it_may_be(message: can.Message) -> None:
    assert len(encode(message, 0.0)) <= LARGEST_RECORD


@given(chunks=st.lists(st.binary(max_size=200)))
def test_no_bytes_raise_and_nonsense_is_never_taken_up_again(chunks: list[bytes]) -> None:
    records = Records("cell")
    for chunk in chunks:
        was_intact = records.intact
        arrived = records.feed(chunk)
        assert was_intact or not arrived


def test_one_wrong_byte_ends_the_trust_in_a_stream() -> None:
    good = encode(can.Message(arbitration_id=1, data=b"ok"), 0.0)
    records = Records("cell")
    assert len(records.feed(good + b"GET / HTTP/1.1\r\n" + good)) == 1
    assert not records.intact
    assert records.feed(good) == []


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=1 << 29),
        can.Message(arbitration_id=0x800, is_extended_id=False),
        can.Message(arbitration_id=-1),
        can.Message(data=bytes(9)),
        can.Message(data=bytes(65), is_fd=True),
        can.Message(data=b"abc", dlc=4),
        can.Message(is_fd=True, is_remote_frame=True),
    ],
    ids=repr,
)
def test_a_frame_that_contradicts_itself_is_the_callers_mistake(message: can.Message) -> None:
    with pytest.raises(ValueError, match="no CAN frame is like this"):
        encode(message, 0.0)


@given(answer=st.booleans(), channel=st.integers(0, 2**32 - 1), token=st.integers(0, 2**64 - 1))
def test_greetings_are_understood(answer: bool, channel: int, token: int) -> None:  # noqa: FBT001
    greeting = Greeting(answer=answer, channel=channel, token=token)
    data = greeting.encode()
    assert len(data) == GREETING_BYTES
    assert read_greeting(data) == greeting


@given(data=st.binary(max_size=20))
def test_nothing_else_is_a_greeting(data: bytes) -> None:
    assert read_greeting(data) is None


@given(name=st.text(min_size=1, max_size=12).filter(lambda name: not name.isdigit()))
def test_a_named_channel_lies_below_the_ports_that_systems_hand_out(name: str) -> None:
    assert 1024 < first_port(name) <= 32768 - SEATS


def test_named_channels_do_not_overlap() -> None:
    firsts = sorted({first_port(f"channel {index}") for index in range(200)})
    assert all(b - a >= SEATS for a, b in pairwise(firsts))


@pytest.mark.parametrize("port", [0, 80, 65536 - SEATS + 1, "70000"])
def test_a_channel_that_is_no_port_is_refused(port: int | str) -> None:
    with pytest.raises(ValueError, match="choose one, or a name"):
        first_port(port)


"""[s] A frame that has not come by then will not come."""


def test_leaving_twice_is_harmless_and_final(channel: str, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING), LoopbackBus(channel) as bus:
        bus.shutdown()
        bus.shutdown()
        with pytest.raises(can.CanOperationError, match="shut down"):
            bus.send(can.Message())
        with pytest.raises(can.CanOperationError, match="shut down"):
            bus.recv(0)
    del bus
    assert not caplog.records
    assert not [thread for thread in threading.enumerate() if channel in thread.name]


def test_who_reads_on_after_leaving_touches_no_descriptor_of_others(channel: str) -> None:
    with LoopbackBus(channel) as one:
        two = LoopbackBus(channel)
        for index in range(3):
            one.send(can.Message(arbitration_id=index))
        one.shutdown()  # what was sent has arrived
        assert two.recv(SOON)
        bell = two._bell
        two.shutdown()
        with socket.socket() as other:
            assert other.fileno() <= bell, "the system gives the lowest descriptor that is free"
            assert [message.arbitration_id for _ in range(2) if (message := two.recv(0))] == [1, 2]
            with pytest.raises(can.CanOperationError, match="shut down"):
                two.recv(0)


def test_what_was_sent_before_leaving_still_arrives(channel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(membership, "LINGER", SOON)  # the reader reads, however slow the machine is
    message, arrived = can.Message(data=bytes(64), is_fd=True), 0
    with LoopbackBus(channel) as reader:
        sender = LoopbackBus(channel)
        for _ in range(8000):
            sender.send(message)
        leaving = threading.Thread(target=sender.shutdown)
        leaving.start()
        while arrived < 8000 and reader.recv(SOON):
            arrived += 1
        leaving.join()
    assert arrived == 8000


def test_leaving_wakes_whoever_waits_for_a_frame(channel: str) -> None:
    bus, ended = LoopbackBus(channel), threading.Event()

    def wait() -> None:
        with pytest.raises(can.CanOperationError):
            bus.recv(None)
        ended.set()

    thread = threading.Thread(target=wait)
    thread.start()
    bus.shutdown()
    assert ended.wait(SOON)
    thread.join()


def test_the_seat_of_one_who_left_is_free_again(channel: str) -> None:
    with LoopbackBus(channel) as stays:
        for _ in range(2 * SEATS):
            LoopbackBus(channel).shutdown()
        with LoopbackBus(channel) as newcomer:
            newcomer.send(can.Message(arbitration_id=9))
            assert stays.recv(SOON)


def test_a_full_bus_says_so(channel: str) -> None:
    members = [LoopbackBus(channel) for _ in range(SEATS)]
    with pytest.raises(can.CanInitializationError, match="no free seat"):
        LoopbackBus(channel)
    members[0].send(can.Message(arbitration_id=1))
    assert all(member.recv(SOON) for member in members[1:])
    for member in members:
        member.shutdown()


def test_many_who_join_at_the_same_moment_all_hear_each_other(
    channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(membership, "ANSWER", SOON)  # all answer, however slow the machine is
    members: list[LoopbackBus] = []
    joiners = [threading.Thread(target=lambda: members.append(LoopbackBus(channel))) for _ in range(8)]
    for joiner in joiners:
        joiner.start()
    for joiner in joiners:
        joiner.join()
    for index, member in enumerate(members):
        member.send(can.Message(arbitration_id=index))
    for index, member in enumerate(members):
        heard = [message.arbitration_id for _ in range(7) if (message := member.recv(SOON))]
        assert sorted(heard) == [other for other in range(8) if other != index]
        assert member.recv(0) is None, "nobody is heard twice"
    for member in members:
        member.shutdown()


def test_who_leaves_while_being_greeted_leaves_nothing_behind(
    channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    met: list[socket.socket] = []

    def meet(*where: object) -> socket.socket:
        """Connect to somebody whose process ends at this moment."""
        met.append(connect(*where))
        leaving.accept()[0].close()
        met[-1].shutdown(socket.SHUT_WR)  # a reset may come late; from here on every word fails
        return met[-1]

    connect = socket.create_connection
    monkeypatch.setattr(socket, "create_connection", meet)
    with socket.create_server((HOST, first_port(channel) + 1)) as leaving, LoopbackBus(channel) as bus:
        assert bus.statistics.members == 0
        assert [connection.fileno() for connection in met] == [-1]


def test_who_gets_no_seat_since_the_system_has_no_socket_left_leaves_nothing_behind(
    channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_left(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    bells: list[int] = []

    def eventfd(*flags: int) -> int:
        bells.append(ring(*flags))
        return bells[-1]

    ring = os.eventfd
    monkeypatch.setattr(os, "eventfd", eventfd)
    monkeypatch.setattr(socket, "socket", none_left)
    with pytest.raises(OSError, match="Too many"):
        LoopbackBus(channel)
    (bell,) = bells
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(bell)
