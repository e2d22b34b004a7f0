"""A serial line: as slow as it is told to be, ours alone, and gone when it is unplugged."""

from __future__ import annotations

import asyncio
import errno
import os
import termios
import threading
import tty
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from serial import Serial

from robotree.protocol import Endpoint, Frame, Parser
from robotree.protocol.errors import BadUrl, LinkBroken, LinkRefused
from robotree.protocol.links import serial
from robotree.protocol.links.in_thread import opened
from robotree.protocol.links.link import Listener
from robotree.protocol.links.url import connect, parse
from robotree.protocol.messages import GoalStatus, Heartbeat, Joints
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, check_refused, until

MakeCable = Callable[[], Any]
BEAT = Heartbeat(6, 8, 0, 0, 4)


async def test_an_adapter_that_is_unplugged_ends_the_link_and_says_so(make_cable: MakeCable) -> None:
    cable, ends = make_cable(), RecordingHandlers()
    await connect(cable.url(0), ends)
    cable.pull()
    await until(lambda: ends[0].reasons)
    (reason,) = ends[0].reasons
    assert isinstance(reason, LinkBroken)
    assert str(reason) == f"{cable.url(0)} broke: it was unplugged"


async def test_a_frame_for_an_adapter_that_is_gone_breaks_the_link(make_cable: MakeCable) -> None:
    cable, ends = make_cable(), RecordingHandlers()
    link = await connect(cable.url(0), ends)
    cable.pull()
    link.send(b"nobody")  # before the loop can tell that the port is gone
    await until(lambda: ends[0].reasons)
    assert [type(reason) for reason in ends[0].reasons] == [LinkBroken]
    link.send(b"too late")
    assert link.statistics.dropped == 1


async def unplugged(make_cable: MakeCable, ends: RecordingHandlers) -> Listener:
    """A listener whose adapter is away, and which looks for it again and again."""
    cable = make_cable()
    listener = await serial.listen(serial.read(parse(cable.url(1))), ends, again=0.01)
    cable.pull()
    await until(lambda: not listener.links)
    return listener


async def test_a_listener_has_a_link_again_when_the_adapter_is_back(make_cable: MakeCable) -> None:
    ends = RecordingHandlers()
    listener = await unplugged(make_cable, ends)
    cable = make_cable()
    await until(lambda: listener.links)
    link = await connect(cable.url(0), RecordingHandlers())
    link.send(b"back")
    await until(lambda: ends[1].data == b"back")
    assert len(ends) == 2
    link.close()
    await listener.close()
    assert not listener.links


async def test_an_adapter_without_the_speed_that_is_plugged_in_meanwhile_is_told_once_and_tried_again(
    make_cable: MakeCable, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ends, tried, real = RecordingHandlers(), list[str](), serial.serial.Serial

    def slow(device: str, *rest: Any, **options: Any) -> Serial:  # a pseudo-terminal has every speed
        tried.append(device)
        if len(tried) < 4:
            raise ValueError("Failed to set custom baud rate (4000000)")
        return real(device, *rest, **options)

    listener = await unplugged(make_cable, ends)
    make_cable()
    caplog.clear()
    monkeypatch.setattr(serial.serial, "Serial", slow)
    await until(lambda: listener.links)
    assert len(tried) == 4
    speeds = [each.message for each in caplog.records if "the port has no speed of" in each.message]
    assert len(speeds) == 1
    assert speeds[0].endswith("choose another baud=; tried again every 0.01 s")
    await listener.close()


async def test_a_listener_that_is_closed_while_the_adapter_is_away_stays_closed(
    make_cable: MakeCable,
) -> None:
    listener = await unplugged(make_cable, RecordingHandlers())
    await listener.close()
    cable = make_cable()
    assert asyncio.all_tasks() == {asyncio.current_task()}
    (await connect(cable.url(1), RecordingHandlers())).close()  # nobody holds the port


async def test_a_listener_that_is_closed_while_it_opens_the_port_holds_it_no_longer(
    make_cable: MakeCable, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, real, open_ports = asyncio.get_running_loop(), serial.serial.Serial, list[Serial]()
    begun = loop.create_future()

    def slow(*where: Any, **options: Any) -> Serial:
        loop.call_soon_threadsafe(begun.set_result, None)
        leave.wait()
        open_ports.append(real(*where, **options))
        return open_ports[-1]

    leave = threading.Event()
    listener = await unplugged(make_cable, RecordingHandlers())
    monkeypatch.setattr(serial.serial, "Serial", slow)
    make_cable()
    await begun
    loop.call_later(0.01, leave.set)  # the adapter takes its time, also after we were told to stop
    await listener.close()
    assert [port.is_open for port in open_ports] == [False]


async def test_who_is_cancelled_twice_while_it_opens_a_port_leaves_none_open() -> None:
    """By a time limit, say, and by the end of the program."""
    loop, leave, now_open = asyncio.get_running_loop(), threading.Event(), ["port"]
    begun, over = loop.create_future(), loop.create_future()

    def slow() -> str:
        loop.call_soon_threadsafe(begun.set_result, None)
        leave.wait()
        return "port"

    def close(port: str) -> None:
        now_open.remove(port)
        loop.call_soon_threadsafe(over.set_result, None)

    task = asyncio.ensure_future(opened(slow, close))
    await begun
    for _ in range(2):
        task.cancel()
        await asyncio.wait([task], timeout=0)  # it begins to wait for the thread, and then no longer
    assert task.cancelled()
    leave.set()
    await asyncio.wait_for(over, 60)
    assert now_open == []


async def test_who_is_cancelled_as_a_port_has_just_been_opened_leaves_none_open() -> None:
    threads, now_open, asked = ThreadPoolExecutor(1), list[str](), threading.Event()
    asyncio.get_running_loop().set_default_executor(threads)

    def open_it() -> str:
        asked.wait()
        now_open.append("port")
        return "port"

    task = asyncio.ensure_future(opened(open_it, now_open.remove))
    await asyncio.sleep(0)
    asked.set()
    threads.submit(lambda: None).result()  # the one thread is through with it, and the loop has not heard so
    assert now_open == ["port"]
    task.cancel()
    await asyncio.wait([task])
    assert now_open == []


async def test_a_port_is_ours_alone(make_cable: MakeCable) -> None:
    cable = make_cable()
    link = await connect(cable.url(0), RecordingHandlers())
    refused = await check_refused(lambda accept: connect(cable.url(0), accept))
    assert refused.cause == "another program uses it; end that program"
    link.close()
    (await connect(cable.url(0), RecordingHandlers())).close()


async def test_a_device_that_is_not_there_is_told_from_what_is_no_port(tmp_path: Path) -> None:
    refused = await check_refused(lambda accept: connect(f"serial:{tmp_path}/ttyUSB0", accept))
    assert refused.cause.startswith("there is no such device; plug it in")
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "file"):
        refused = await check_refused(lambda accept, path=path: connect(f"serial:{path}", accept))
        assert refused.cause == "it is no serial port; name the device of one"


async def test_without_the_right_to_a_port_its_group_is_named(
    make_cable: MakeCable, monkeypatch: pytest.MonkeyPatch
) -> None:
    cable = make_cable()

    def forbidden(*_: object, **__: object) -> None:  # root, who may run this test, may open everything
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(serial.serial, "Serial", forbidden)
    with pytest.raises(LinkRefused) as refused:
        await connect(cable.url(0), RecordingHandlers())
    group = cable.devices[0].group()
    assert refused.value.cause == f"permission denied; join the group {group} and log in again"


async def test_the_port_has_the_speed_that_the_address_says(make_cable: MakeCable) -> None:
    cable = make_cable()
    for options, speed in (("", termios.B57600), ("?baud=115200", termios.B115200)):
        link = await connect(cable.url(0, options), RecordingHandlers())
        descriptor = os.open(cable.devices[0], os.O_RDWR | os.O_NOCTTY)
        assert termios.tcgetattr(descriptor)[4:6] == [speed, speed]
        os.close(descriptor)
        link.close()


@pytest.mark.parametrize(
    ("url", "advice"),
    [
        ("serial:", "write serial:DEVICE, as in serial:/dev/ttyUSB0"),
        ("serial:/dev/x?baud=fast", "baud=fast is no speed from 50 to 4000000"),
        ("serial:/dev/x?baud=0", "baud=0 is no speed"),
        ("serial:/dev/x?rtscts=yes", "rtscts=yes is neither 0 nor 1"),
        ("serial:/dev/x?speed=9600", "option 'speed' is unknown; there is baud, rtscts"),
    ],
)
def test_an_address_that_means_nothing_is_refused(url: str, advice: str) -> None:
    with pytest.raises(BadUrl, match=advice):
        serial.read(parse(url))


def test_an_address_that_was_taken_apart_is_written_the_same() -> None:
    for text in ("serial:/dev/ttyUSB0?baud=57600", "serial:/dev/ttyACM0?baud=115200&rtscts=1"):
        assert str(serial.read(parse(text))) == text


class SlowDriver(Serial):
    """A port whose driver keeps what it is given until the line has sent it; pseudo-terminals do not."""

    kept = 0

    @property
    def out_waiting(self) -> int:
        return self.kept


def joints(moment: int) -> Joints:
    return Joints(moment, (0.5,) * 8, 6)


async def test_on_a_slow_line_telemetry_waits_where_it_is_superseded_not_in_the_driver() -> None:
    far, near = os.openpty()
    tty.setraw(near)
    ear, heard = Parser(), list[Frame]()
    # The kernel carries bytes from one end to the other in its own time.
    asyncio.get_running_loop().add_reader(far, lambda: heard.extend(ear.feed(os.read(far, 4096))))
    port = SlowDriver(os.ttyname(near), 57600, timeout=0, write_timeout=0, exclusive=True)
    link = serial.SerialLink(port, serial.Setting(os.ttyname(near)))
    link.begin(RecordingHandler)
    speaker = Endpoint(link, system=1, component=1, on_frame=lambda _: None)
    ack = GoalStatus(7, 1, 0.0, 0, 0, 1, 1, 2, "there")
    speaker.send(joints(0), telemetry=True)
    first = link.statistics.sent
    assert first
    assert not link.congested
    port.kept = 4000
    for i in range(1, 100):
        speaker.send(joints(i), telemetry=True)
    speaker.send(ack)
    assert link.congested
    assert link.statistics.sent == first
    assert link.statistics.superseded == 98
    port.kept = 0
    await until(lambda: len(heard) == 3)
    assert [frame.message for frame in heard] == [joints(0), joints(99), ack]
    assert ear.statistics.lost == 0
    link.close()
    asyncio.get_running_loop().remove_reader(far)
    os.close(far)
    os.close(near)
