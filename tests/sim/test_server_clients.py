"""Messages of the controller reach all clients that read, and no client gets more than its share."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Hashable

import pytest

from robotree.protocol import Parser
from robotree.protocol.errors import LinkClosed, LinkOverrun
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Handler, LinkStatistics, Unsent, encoded
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    Heartbeat,
    MavCmd,
    ModeKind,
    Ping,
    SetMode,
    Statustext,
)
from robotree.sim.firmware import Outgoing
from robotree.sim.serving.connection import MAX_REFUSED_BYTES, Connection
from robotree.sim.serving.server import MAX_CLIENTS, Server, serving
from robotree.sim.serving.throttle import BURST, PIECE, RESTOCK, STORE

ANY = "tcp:127.0.0.1:0"
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
