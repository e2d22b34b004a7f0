"""The loopback bus between real processes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from subprocess import Popen

import can
import pytest

from tests.waiting import wait_until

Spawn = Callable[..., "Popen[str]"]
SOON = 60.0
ECHO = """
import sys, can
with can.Bus(interface="robotree", channel=sys.argv[1]) as bus:
    print("here", flush=True)
    for message in bus:
        if message.arbitration_id == 0:
            break
        message.arbitration_id += 0x100
        bus.send(message)
print(bus.statistics.received, flush=True)
"""


def echo(spawn: Spawn, channel: str) -> Popen[str]:
    """A process that answers every frame under an identifier 0x100 higher."""
    process = spawn("-c", ECHO, channel)
    assert process.stdout
    assert process.stdout.readline() == "here\n"
    return process


@pytest.fixture
def bus(channel: str) -> can.BusABC:
    return can.Bus(interface="robotree", channel=channel)


def members(bus: can.BusABC) -> int:
    return bus.statistics.members  # type: ignore[attr-defined, no-any-return]  # it is a LoopbackBus


def test_frames_go_there_and_back(bus: can.BusABC, spawn: Spawn, channel: str) -> None:
    with bus:
        far = echo(spawn, channel)
        for size in (0, 8, 64):
            sent = can.Message(arbitration_id=1, data=os.urandom(size), is_fd=size > 8)
            bus.send(sent)
            came = bus.recv(SOON)
            assert came is not None
            assert (came.arbitration_id, came.data) == (0x101, sent.data)
        bus.send(can.Message(arbitration_id=0))
        assert far.wait(SOON) == 0


def test_a_killed_member_is_missed_at_once_and_the_others_go_on(
    bus: can.BusABC, spawn: Spawn, channel: str
) -> None:
    with bus:
        first, second = echo(spawn, channel), echo(spawn, channel)
        wait_until(lambda: members(bus) == 2)
        first.kill()
        first.wait()
        bus.send(can.Message(arbitration_id=1))
        came = bus.recv(SOON)
        assert came is not None
        assert came.arbitration_id == 0x101
        bus.recv(0)
        assert members(bus) == 1
        third = echo(spawn, channel)
        wait_until(lambda: members(bus) == 2)
        bus.send(can.Message(arbitration_id=0))
        assert second.wait(SOON) == third.wait(SOON) == 0


def test_the_first_member_is_nobody_special(spawn: Spawn, channel: str) -> None:
    founder = echo(spawn, channel)
    with can.Bus(interface="robotree", channel=channel) as one:
        founder.kill()
        founder.wait()
        with can.Bus(interface="robotree", channel=channel) as two:
            two.send(can.Message(arbitration_id=1))
            assert one.recv(SOON)


def test_a_stopped_process_joins_in_again_when_it_goes_on(
    bus: can.BusABC, spawn: Spawn, channel: str
) -> None:
    with bus:
        far = echo(spawn, channel)
        far.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, far.pid, os.WSTOPPED | os.WNOWAIT)
        with can.Bus(interface="robotree", channel=channel) as newcomer:  # finds a member that cannot answer
            newcomer.send(can.Message(arbitration_id=1))
            assert bus.recv(SOON)
            far.send_signal(signal.SIGCONT)
            wait_until(lambda: members(newcomer) == 2)
            newcomer.send(can.Message(arbitration_id=2))
            came = newcomer.recv(SOON)
            assert came is not None
            assert came.arbitration_id == 0x102


def test_python_cans_logger_watches_the_bus(bus: can.BusABC, spawn: Spawn, channel: str) -> None:
    with bus:
        logger = spawn("-u", "-m", "can.logger", "-i", "robotree", "-c", channel, "--passive")
        wait_until(lambda: members(bus) == 1)
        bus.send(can.Message(arbitration_id=0x18DB0001, data=b"\x03abc"))
        bus.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(20), is_fd=True))
        assert logger.stdout
        lines = (line.split() for line in logger.stdout if line.startswith("Timestamp"))
        extended, flexible = next(lines), next(lines)
        assert extended[2:6] == ["ID:", "18db0001", "X", "Rx"]
        assert extended[6:] == ["DL:", "4", "03", "61", "62", "63", "Channel:", channel]
        assert flexible[2:9] == ["ID:", "123", "S", "Rx", "F", "DL:", "20"]
        logger.send_signal(signal.SIGINT)
        assert logger.wait(SOON) == 0
