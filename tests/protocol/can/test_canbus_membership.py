"""Who comes to the loopback bus finds everybody; who leaves it, in whatever moment, leaves nothing behind."""

from __future__ import annotations

import errno
import logging
import os
import socket
import threading

import can
import pytest

from robotree.protocol.canbus import LoopbackBus, first_port, membership
from robotree.protocol.canbus.seats import HOST, SEATS

SOON = 60.0
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
