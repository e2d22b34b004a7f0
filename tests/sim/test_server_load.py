"""A controller under load: floods, crowds and clients that never read cost themselves, not the arm's pace.

A busy machine may withhold the processor; the time that our threads waited for one, as the kernel counts it,
is forgiven.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
from collections.abc import AsyncIterator, Hashable

import pytest

from robotree.protocol import Parser
from robotree.protocol.errors import LinkClosed, LinkOverrun
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Handler, LinkStatistics, Unsent, encoded
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    CommandLong,
    ControlStatus,
    Heartbeat,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    Ping,
    SetMode,
    Statustext,
)
from robotree.protocol.testing import until
from robotree.sim.firmware import Outgoing
from robotree.sim.serving import server as server_module
from robotree.sim.serving.connection import MAX_REFUSED_BYTES, Connection
from robotree.sim.serving.realtime import LARGEST_DEBT
from robotree.sim.serving.server import MAX_CLIENTS, MAX_REFUSED, Server, serving
from robotree.sim.serving.throttle import BURST, PIECE, RESTOCK, STORE
from tests.station import BEAT, PATIENCE, Station
from tests.withheld import Withheld

ANY = "tcp:127.0.0.1:0"
UDP = "udp:127.0.0.1:0"


@contextlib.asynccontextmanager
async def keeping_pace(server: Server) -> AsyncIterator[None]:
    """The world's time goes on like the wall clock's inside the block, but for what is still made good."""
    before, withheld, began = server.pace, Withheld(os.getpid()), time.monotonic()
    yield
    lived, elapsed = (server.pace.time_ms - before.time_ms) / 1000, time.monotonic() - began
    assert lived < elapsed + LARGEST_DEBT + 0.1
    assert lived > 0.97 * elapsed - withheld.seconds - LARGEST_DEBT


async def flood(address: str, messages: list[AnyMessage]) -> None:
    """Send as fast as the far end takes it, and read what comes."""
    host, port = address.removeprefix("tcp:").split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    frames = [encode(each, sequence=i & 255, system=200, component=1) for i, each in enumerate(messages)]
    reading = asyncio.create_task(_drain(reader))
    try:
        while True:
            writer.write(b"".join(frames))
            await writer.drain()
            await asyncio.sleep(0.01)
    finally:
        reading.cancel()
        writer.close()


async def _drain(reader: asyncio.StreamReader) -> None:
    while await reader.read(65536):
        pass


async def test_a_flood_slows_neither_the_arm_nor_others_and_their_stop_is_obeyed() -> None:
    async with serving("arm", ANY) as server:
        client = await Station().dial(server.address)
        await client.ping()
        flooding = asyncio.create_task(flood(server.address, [BEAT] * 2000))
        await asyncio.sleep(0.5)
        async with keeping_pace(server):
            for _ in range(50):
                await client.ping()
            await asyncio.sleep(0.4)
        client.say(SetMode(0, 0, 0, ModeKind.SAFE_STOP))
        await client.told(Mode, mode=ModeKind.SAFE_STOP)
        assert server._controller.firmware.gauges.overrun > 0, "it was a flood"
        flooding.cancel()


async def test_a_flood_of_work_is_carried_out_at_a_bearable_pace() -> None:
    """Every command has to be planned, which takes a millisecond or more of the physics' thread."""
    plan = CommandLong(1, 1, MavCmd.ROBOTREE_GO_TO, 0, 0.3, 0.3, 0.2, 0.5, 0.0, 0.0, 0.0)
    unreachable = CommandLong(1, 1, MavCmd.ROBOTREE_GO_TO, 0, 0.6, 0.3, 0.2, 0.5, 0.0, 0.0, 0.0)
    async with serving("arm", ANY) as server:
        client = await Station().dial(server.address)
        flooding = asyncio.create_task(flood(server.address, [plan, unreachable] * 500))
        await asyncio.sleep(0.5)
        async with keeping_pace(server):
            for _ in range(20):
                await client.ping()
            await asyncio.sleep(0.4)
        flooding.cancel()


@contextlib.asynccontextmanager
async def half_open(address: str, number: int) -> AsyncIterator[None]:
    """Connections on which nothing is ever said."""
    host, port = address.removeprefix("tcp:").split(":")
    writers: list[asyncio.StreamWriter] = []
    try:
        for _ in range(number):
            _, writer = await asyncio.open_connection(host, int(port))
            writers.append(writer)
        yield
    finally:
        for writer in writers:
            writer.transport.abort()


async def test_a_thousand_half_open_connections_keep_nobody_out() -> None:
    async with serving("arm", ANY) as server:
        first = await Station().dial(server.address)
        await first.ping()
        async with keeping_pace(server), half_open(server.address, 1000):
            last = await Station().dial(server.address)
            await last.ping()
            await first.ping()
            await asyncio.sleep(0.4)
            assert len(server._connections) <= MAX_CLIENTS


async def test_where_all_places_are_taken_by_speakers_the_newcomer_is_told_so() -> None:
    async with serving("rover", ANY) as server:
        crowd = [await Station(1 + i).dial(server.address) for i in range(MAX_CLIENTS)]
        for each in crowd:
            await each.ping()
        newcomer = await Station(250).dial(server.address)
        told = await newcomer.told(Statustext)
        assert isinstance(told, Statustext)
        assert f"{MAX_CLIENTS} clients" in told.text
        async with asyncio.timeout(PATIENCE):
            await newcomer.ended
        crowd[0].link.close()
        await crowd[0].ended
        await (await Station(251).dial(server.address)).ping()


@contextlib.asynccontextmanager
async def beating(crowd: list[Station]) -> AsyncIterator[None]:
    """All of a crowd say a heartbeat twice a second inside the block."""

    async def beat() -> None:
        while True:
            for each in crowd:
                each.say(BEAT)
            await asyncio.sleep(0.5)

    task = asyncio.create_task(beat())
    yield
    task.cancel()


@contextlib.asynccontextmanager
async def clients(address: str, count: int, first: int = 1) -> AsyncIterator[list[Station]]:
    """Some clients with system ids in a row, who leave at the end."""
    crowd = [await Station(first + i).dial(address) for i in range(count)]
    yield crowd
    for each in crowd:
        each.link.close()
    async with asyncio.timeout(PATIENCE):
        for each in crowd:
            await each.ended


@contextlib.asynccontextmanager
async def full_house(address: str) -> AsyncIterator[list[Station]]:
    """As many clients as are served, all served."""
    async with clients(address, MAX_CLIENTS) as crowd:
        for each in crowd:
            await each.ping()
        yield crowd


@pytest.mark.parametrize("url", ["tcp:127.0.0.1:0", "udp:127.0.0.1:0"])
async def test_a_stop_of_who_is_not_served_is_obeyed_and_answered(url: str) -> None:
    async with (
        serving("rover", url) as server,
        full_house(server.address) as crowd,
        beating(crowd),
        clients(server.address, 1, first=250) as (newcomer,),
    ):
        await newcomer.told(Statustext)
        newcomer.say(CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7))
        await newcomer.told(CommandAck, result=MavResult.ACCEPTED)
        await crowd[0].told(Mode, mode=ModeKind.SAFE_STOP)
        newcomer.say(Ping(0, 77))
        newcomer.say(SetMode(0, 0, 0, ModeKind.SAFE_STOP))
        await newcomer.told(Mode, mode=ModeKind.SAFE_STOP)
        assert not [each for each in newcomer.heard if isinstance(each, Ping)], "nothing else is heard"


async def test_a_flood_of_datagrams_of_who_is_not_served_costs_nobody_anything_that_lasts() -> None:
    async with (
        serving("rover", UDP) as server,
        full_house(server.address) as crowd,
        beating(crowd),
        clients(server.address, 1, first=250) as (newcomer,),
    ):
        began = time.monotonic()
        async with keeping_pace(server):
            for _ in range(500):
                newcomer.say(BEAT)
                await asyncio.sleep(0.002)
        told = [each for each in newcomer.heard if isinstance(each, Statustext)]
        assert 1 <= len(told) <= 2 * (1 + time.monotonic() - began), "once a second, in two pieces at most"
        await until(lambda: not server._refused_clients)
        await crowd[0].ping()
        links = server._controller.firmware._schedule.links
        await until(lambda: len(links) == MAX_CLIENTS)


async def test_short_clients_over_datagrams_leave_their_places_to_those_who_come_after_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(server_module, "SILENT_AFTER", 0.5)
    async with serving("rover", UDP) as server:
        async with full_house(server.address):
            pass  # that they have left nobody hears
        async with clients(server.address, 1, first=250) as (newcomer,), beating([newcomer]):
            await newcomer.told(Mode)
            await newcomer.ping()
            assert len(server._connections) == MAX_CLIENTS


async def test_more_who_are_not_served_than_can_be_told_so_leave_nothing_behind() -> None:
    async with (
        serving("rover", ANY) as server,
        full_house(server.address) as crowd,
        beating(crowd),
        clients(server.address, MAX_REFUSED + 8, first=200) as others,
    ):
        async with asyncio.timeout(PATIENCE):
            for each in others:
                await each.ended
        await until(lambda: not server._refused_clients)
        assert len(server._connections) == MAX_CLIENTS


async def test_a_client_that_never_reads_costs_nothing_but_its_own_telemetry() -> None:
    async with serving("arm", ANY) as server:
        host, port = server.address.removeprefix("tcp:").split(":")
        reader, writer = await asyncio.open_connection(host, int(port), limit=1024)
        reader._transport.pause_reading()  # type: ignore[attr-defined]
        for msgid in (57600, 57601, 57602):
            order = CommandLong(1, 1, MavCmd.SET_MESSAGE_INTERVAL, 0, msgid, 5000.0, 0, 0, 0, 0, 0)
            writer.write(encode(order, sequence=0, system=9, component=1))
        client = await Station().dial(server.address)
        await client.ping()
        async with keeping_pace(server):
            await asyncio.sleep(1.0)
            for _ in range(20):
                await client.ping()
        assert all(each.endpoint.link.statistics.waiting < 200_000 for each in server._connections.values())
        writer.transport.abort()


async def test_control_ends_with_the_link_of_its_owner() -> None:
    async with serving("rover", ANY) as server:
        owner, other = await Station(9).dial(server.address), await Station(10).dial(server.address)
        owner.say(CommandLong(1, 1, MavCmd.REQUEST_OPERATOR_CONTROL, 0, 1.0, *(0.0,) * 6))
        await other.told(ControlStatus, gcs_main=9)
        other.heard.clear()
        owner.link.close()
        freed = await other.told(ControlStatus, gcs_main=0)
        assert isinstance(freed, ControlStatus)
        assert freed.gcs_main == 0


NEWS = Statustext(6, "hello", 0, 0)
ANSWER = CommandAck(MavCmd.REQUEST_MESSAGE, 0, 0, 0, 255, 190)
PING = encode(Ping(0, 1), sequence=0, system=255, component=190)
TOO_MUCH = Heartbeat(0, 0, 0, 2**32, 0)
"""Has a field that cannot hold its value."""


class Wire:
    """A link whose far end is this object; it may overrun at the next frame, and tells so at once."""

    controller = "wire"

    def __init__(self, server: Server, name: str) -> None:
        self.address, self.overruns, self.congested = f"test:{name}", False, False
        self.statistics = LinkStatistics(sent=0, received=0, waiting=0, superseded=0, dropped=0)
        self.heard: list[AnyMessage] = []
        self._parser = Parser()
        self._handler: Handler | None = None
        self._handler = server.accept(self)
        self.connection = [*server._connections.values()][-1]

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        del topic
        if self.overruns:
            self._end(LinkOverrun(self.address, 1))
        elif self._handler is not None:
            self.heard += [each.message for each in self._parser.feed(encoded(frame))]

    def bring(self, data: bytes) -> None:
        """The far end says something."""
        if self._handler is not None:
            self._handler.received(data)

    def close(self) -> None:
        self._end(LinkClosed(self.address, by_us=True))

    def _end(self, reason: LinkOverrun | LinkClosed) -> None:
        handler, self._handler = self._handler, None
        if handler is not None:
            handler.closed(reason)


def to(connection: Connection, message: AnyMessage) -> Outgoing:
    return Outgoing(message, connection.endpoint)


async def test_a_client_that_overruns_while_all_are_told_takes_nothing_from_the_others() -> None:
    async with serving("rover", ANY) as server:
        first, second, third = (Wire(server, name) for name in "abc")
        first.overruns = True
        server._deliver([Outgoing(NEWS), to(third.connection, ANSWER)])
        assert second.heard == [NEWS]
        assert third.heard == [NEWS, ANSWER]
        assert first.connection not in server._connections.values()


async def test_a_message_that_cannot_be_said_takes_no_other_along_and_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with serving("rover", ANY) as server:
        wire = Wire(server, "a")
        with caplog.at_level(logging.ERROR):
            server._deliver([Outgoing(TOO_MUCH), to(wire.connection, TOO_MUCH), to(wire.connection, ANSWER)])
        assert wire.heard == [ANSWER]
        assert server.unsaid == {"Heartbeat": 2}
        assert [each.getMessage() for each in caplog.records] == ["Heartbeat could not be told to test:a"]


async def test_who_comes_again_and_again_is_not_heard_more_for_it() -> None:
    async with serving("rover", ANY) as server:
        began, parsed, visits = asyncio.get_running_loop().time(), 0, 60
        for _ in range(visits):
            wire = Wire(server, "a")
            wire.bring(bytes(3 * int(BURST)))
            wire.close()
            parsed += wire.connection.endpoint.statistics.bytes
        took = asyncio.get_running_loop().time() - began
        assert parsed <= STORE + RESTOCK * took + visits * 3 * PIECE
        await asyncio.sleep(0)
        last = Wire(server, "b")
        last.bring(PING)
        assert last.connection.endpoint.statistics.received == 1, "a word is heard of everybody"


async def test_of_a_client_without_a_place_no_more_is_parsed_than_it_may_say() -> None:
    async with serving("rover", ANY) as server:
        wires = [Wire(server, str(number)) for number in range(MAX_CLIENTS)]
        for wire in wires:
            wire.bring(PING)
        late = Wire(server, "late")
        (refused,) = server._refused_clients.values()
        late.bring(bytes(10 * MAX_REFUSED_BYTES))
        assert refused.endpoint.statistics.bytes <= MAX_REFUSED_BYTES
        late.close()


async def test_of_a_piece_whose_first_word_ended_the_link_only_a_stop_is_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with serving("rover", ANY) as server:
        posted: list[AnyMessage] = []
        monkeypatch.setattr(server._controller, "post", lambda frame, *_: posted.append(frame.message))
        wire, stop = Wire(server, "a"), SetMode(0, 0, 0, ModeKind.SAFE_STOP)
        wire.close()
        wire.connection.received(PING + encode(stop, sequence=1, system=255, component=190) + PING, None)
        assert posted == [stop]
