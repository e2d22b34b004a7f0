"""Links over CAN, and the loopback bus, between real processes: what is sent arrives, who dies is missed."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from subprocess import Popen

import can
import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.errors import LinkBroken, LinkClosed
from robotree.protocol.links.can import link as can_link
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import Statustext
from robotree.protocol.testing import RecordingHandler, until
from tests.waiting import wait_until

Spawn = Callable[..., "Popen[str]"]
LONG = 60.0
"""[s] that no test takes, however slow the machine is."""
CONTROLLER = """
import asyncio, sys
from robotree.protocol import Endpoint
from robotree.protocol.links.can import link
from robotree.protocol.links.url import listen

link.TRANSFER_TIMEOUT = float(sys.argv[2])

def echo(link):
    endpoint = Endpoint(link, system=1, component=1, on_frame=lambda frame: endpoint.send(frame.message))
    return endpoint

async def main():
    listener = await listen(sys.argv[1], echo)
    print("here", flush=True)
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
    await listener.close()

asyncio.run(main())
"""


def controller(spawn: Spawn, url: str) -> Popen[str]:
    """A process that sends every message back."""
    process = spawn("-c", CONTROLLER, url, str(LONG))
    assert process.stdout
    assert process.stdout.readline() == "here\n"
    return process


class Ear(RecordingHandler):
    """Keeps the messages too."""

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self.parser = Parser()
        self.texts: list[str] = []

    def received(self, data: bytes) -> None:
        super().received(data)
        for frame in self.parser.feed(data):
            assert isinstance(frame.message, Statustext)
            self.texts.append(frame.message.text)


async def opened(url: str) -> tuple[Link, Ear]:
    ears: list[Ear] = []

    def accept(link: Link) -> Ear:
        ears.append(Ear(link))
        return ears[0]

    return await connect(url, accept), ears[0]


def words(count: int) -> list[str]:
    """Texts short and long, so that some fit one frame of CAN FD and some do not."""
    return [f"{index} " + "x" * (index % 2 * 45) for index in range(count)]


@pytest.mark.parametrize("fd", [0, 1])
async def test_a_burst_comes_back_whole_and_in_order(
    spawn: Spawn, channel: str, fd: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_link, "TRANSFER_TIMEOUT", LONG)
    url = f"can:robotree/{channel}?fd={fd}&silence={LONG:g}"
    process = controller(spawn, url)
    link, ear = await opened(url)
    texts = words(500)
    for index, text in enumerate(texts):
        link.send(encode(Statustext(severity=6, text=text), sequence=index, system=255, component=1))
    await until(lambda: len(ear.texts) == len(texts) or ear.reasons, LONG)
    assert ear.texts == texts
    statistics = ear.parser.statistics
    assert (statistics.lost, statistics.late, statistics.bad_crc, statistics.skipped) == (0, 0, 0, 0)
    link.close()
    await until(lambda: bool(ear.reasons))
    process.communicate("end\n", timeout=LONG)
    assert process.returncode == 0


async def test_a_controller_that_ends_says_so(spawn: Spawn, channel: str) -> None:
    url = f"can:robotree/{channel}?silence={LONG:g}"
    process = controller(spawn, url)
    _, ear = await opened(url)
    process.communicate("end\n", timeout=LONG)
    await until(lambda: bool(ear.reasons))
    assert [type(each) for each in ear.reasons] == [LinkClosed]


async def test_a_killed_controller_is_missed_and_its_successor_found(spawn: Spawn, channel: str) -> None:
    url = f"can:robotree/{channel}?silence=0.6"
    process = controller(spawn, url)
    _, ear = await opened(url)
    process.kill()
    await until(lambda: bool(ear.reasons))
    assert [type(each) for each in ear.reasons] == [LinkBroken]
    assert "nothing came for 0.6 s" in str(ear.reasons[0])
    url = f"can:robotree/{channel}?silence={LONG:g}"
    controller(spawn, url)
    link, second = await opened(url)
    link.send(encode(Statustext(severity=6, text="hello"), sequence=0, system=255, component=1))
    await until(lambda: second.texts == ["hello"])
    link.close()
    await until(lambda: bool(second.reasons))


async def test_a_session_does_not_survive_its_controller(spawn: Spawn, channel: str) -> None:
    """The successor is up before the silence is noticed, knows no such session, and says so."""
    url = f"can:robotree/{channel}?silence={LONG:g}"
    process = controller(spawn, url)
    _, ear = await opened(url)
    process.kill()
    process.wait()
    controller(spawn, url)
    await until(lambda: bool(ear.reasons))
    assert [type(each) for each in ear.reasons] == [LinkClosed]


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
