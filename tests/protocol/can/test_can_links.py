"""Links over CAN: what passes, in which order, and the addresses of their ends."""

from __future__ import annotations

import asyncio
import socket

import pytest

from robotree.protocol.canbus import channel_id, first_port
from robotree.protocol.canbus.records import Greeting
from robotree.protocol.canbus.seats import HOST
from robotree.protocol.errors import BadUrl, LinkClosed, LinkRefused
from robotree.protocol.links.can import CanAddress
from robotree.protocol.links.url import connect as connect_url
from robotree.protocol.links.url import listen as listen_url
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, until
from tests.protocol.can.ends import connected, listening


async def test_a_burst_of_long_frames_arrives_whole_and_in_order(address: CanAddress) -> None:
    at_controller, at_host = RecordingHandlers(), RecordingHandlers()
    async with listening(address, at_controller), connected(address, at_host) as link:
        (far,) = [recorder.link for recorder in at_controller]
        frames = [
            bytes((index % 256, size % 256)) * (size // 2) for index, size in enumerate(range(2, 280, 2))
        ]
        for frame in frames:
            link.send(frame)
            far.send(frame)
        assert link.congested
        whole = b"".join(frames)
        await until(lambda: len(at_controller[0].data) >= len(whole))
        await until(lambda: len(at_host[0].data) >= len(whole))
        assert at_controller[0].data == at_host[0].data == whole
        assert not link.congested


async def test_telemetry_that_waits_is_superseded_and_the_rest_is_not(here: CanAddress) -> None:
    at_controller = RecordingHandlers()
    async with listening(here, at_controller), connected(here, RecordingHandlers()) as link:
        link.send(bytes(200))  # under way until the far end gives leave
        for index in range(1, 6):
            link.send(bytes((index,)) * 100, "joints")
        link.send(b"command")
        await until(lambda: at_controller[0].data.endswith(b"command"))
        assert at_controller[0].data == bytes(200) + b"\x05" * 100 + b"command"
        assert link.statistics.superseded == 4


async def test_on_a_crowded_bus_order_is_kept_and_telemetry_superseded(here: CanAddress) -> None:
    at_controller, at_host = RecordingHandlers(), RecordingHandlers()
    async with listening(here, at_controller) as listener, connected(here, at_host):
        link = at_controller[0].link
        with socket.create_connection((HOST, first_port(here.channel))) as sleeper:
            sleeper.sendall(Greeting(answer=False, channel=channel_id(here.channel), token=1).encode())
            await until(lambda: listener._port.bus.statistics.members == 2)  # type: ignore[attr-defined]
            sent = 0
            while not link.congested:
                link.send(sent.to_bytes(4) + bytes(50))
                sent += 1
                if sent % 50 == 0:
                    await asyncio.sleep(0)
            for index in range(5):
                link.send(b"telemetry %d" % index, "telemetry")
            link.send(b"command")
            expected = (
                b"".join(index.to_bytes(4) + bytes(50) for index in range(sent)) + b"telemetry 4command"
            )
            await until(lambda: len(at_host[0].data) >= len(expected))
            assert at_host[0].data == expected
            assert link.statistics.superseded == 4


async def test_an_unknown_interface_is_refused(channel: str) -> None:
    with pytest.raises(LinkRefused, match="teleport"):
        await connect_url(f"can:teleport/{channel}", RecordingHandler)


async def test_a_bus_that_other_machines_reach_must_be_asked_for() -> None:
    with pytest.raises(BadUrl, match="use an interface of this machine"):
        await listen_url("can:udp_multicast/239.0.0.1", RecordingHandler)


async def test_the_address_of_a_listener_is_what_hosts_need(here: CanAddress) -> None:
    at_host = RecordingHandlers()
    async with listening(here, RecordingHandler) as listener:
        link = await connect_url(listener.address, at_host)
        assert link.address == listener.address
        await listener.close()
        await until(lambda: bool(at_host[0].reasons))
        assert isinstance(at_host[0].reasons[0], LinkClosed)
