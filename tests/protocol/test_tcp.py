"""TCP: whole frames, newest telemetry, and nobody waits for a reader who does not read."""

from __future__ import annotations

import asyncio
import socket
import struct
from typing import TYPE_CHECKING

import pytest

from robotree.protocol import Endpoint, Parser
from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError, LinkOverrun
from robotree.protocol.links import tcp
from robotree.protocol.links.outbox import BOUND
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import GoalStatus, Gripper, Joints
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, until

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame
    from robotree.protocol.links.link import Link


LONG = 1000.0
"""[s] that no test takes, however slow the machine is."""


async def settle() -> None:
    await asyncio.sleep(0.005)


class Silent:
    """A client that connects and reads only when it is told to."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.connect(("127.0.0.1", int(address.rpartition(":")[2])))
        self.socket.setblocking(False)

    def read(self) -> bytes:
        """Read what is there; at the end of the connection close it, as clients do."""
        data = b""
        while self.socket.fileno() >= 0:
            try:
                piece = self.socket.recv(65536)
            except BlockingIOError:
                break
            if not piece:
                self.socket.close()
            data += piece
        return data


class Server:
    """Speaks to everyone."""

    def __init__(self) -> None:
        self.endpoints: list[Endpoint] = []
        self.reasons: list[LinkError] = []

    def accept(self, link: Link) -> Endpoint:
        endpoint = Endpoint(
            link, system=1, component=1, on_frame=lambda _: None, on_closed=self.reasons.append
        )
        self.endpoints.append(endpoint)
        return endpoint


async def test_a_slow_reader_costs_nothing_but_its_own_telemetry() -> None:
    server = Server()
    listener = await listen("tcp:0", server.accept)
    slow = Silent(listener.address)
    heard: list[Frame] = []
    await connect(
        listener.address,
        lambda link: Endpoint(link, system=255, component=190, on_frame=heard.append),
    )
    await until(lambda: len(server.endpoints) == 2)
    rounds = 4000
    for i in range(rounds):
        for endpoint in server.endpoints:
            endpoint.send(Joints(i, (0.5,) * 8, 6), telemetry=True)
            endpoint.send(Gripper(i, 0.1, 0.1, 0.0, 1), telemetry=True)
            if i % 100 == 0:
                endpoint.send(GoalStatus(i, 1, 0.0, 0, 0, 1, 1, 2, "x" * 80))
        await asyncio.sleep(0)
    await until(lambda: _newest(heard) == [rounds - 1, rounds - 1])
    assert len(heard) == 2 * rounds + rounds // 100
    lagging = next(each for each in server.endpoints if each.link.congested)
    assert lagging.link.statistics.superseded > 100

    parser, read = Parser(), list["Frame"]()
    while _newest(read) != [rounds - 1, rounds - 1] or lagging.link.statistics.waiting:
        read += parser.feed(slow.read())
        await asyncio.sleep(0.001)
    told = [each.message.key for each in read if isinstance(each.message, GoalStatus)]
    assert told == [*range(0, rounds, 100)]
    assert parser.statistics.skipped == 0
    assert len(read) < 2 * rounds
    slow.socket.close()
    await listener.close()


async def test_what_is_said_to_a_client_that_has_reset_is_dropped_without_a_word_in_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    server = Server()
    listener = await listen("tcp:0", server.accept)
    client = Silent(listener.address)
    await until(lambda: server.endpoints)
    link = server.endpoints[0].link
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.socket.close()
    for _ in range(100):  # the loop does not turn, so nobody has told us of the end yet
        link.send(b"telemetry")
    assert link.statistics.dropped > 90
    await until(lambda: server.reasons)
    assert isinstance(server.reasons[0], LinkBroken)
    assert "reset" in str(server.reasons[0])
    assert not [record for record in caplog.records if record.name == "asyncio"]
    await listener.close()


def _newest(frames: list[Frame]) -> list[int]:
    newest = {type(frame.message): frame.message for frame in frames}
    return [message.time_boot_ms for message in newest.values() if isinstance(message, Joints | Gripper)]


async def test_a_client_that_never_reads_is_cut() -> None:
    server = Server()
    listener = await listen("tcp:0", server.accept)
    mute = Silent(listener.address)
    await until(lambda: server.endpoints)
    status = GoalStatus(1, 1, 0.0, 0, 0, 1, 1, 2, "x" * 80)
    sent = 0
    while not server.reasons and sent < 40 * BOUND:
        for _ in range(1000):
            server.endpoints[0].send(status)
        sent += 1000 * 115
        await asyncio.sleep(0)
    (reason,) = server.reasons
    assert isinstance(reason, LinkOverrun)
    assert reason.waiting > BOUND
    assert "does not read" in str(reason)
    assert listener.links == frozenset()
    mute.socket.close()
    await listener.close()


async def fill(link: Link) -> None:
    """Say so much that some of it stays with us, but not so much that we notice that nobody reads."""
    while True:
        while not link.statistics.waiting:
            link.send(bytes(300))
        for _ in range(100):  # until the system has taken what it can
            await asyncio.sleep(0)
            if not link.statistics.waiting:
                break
        else:
            return


async def test_an_end_waits_for_a_client_that_reads_on_and_not_for_one_that_never_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = asyncio.get_running_loop()
    clock, passed = loop.time, 0.0
    monkeypatch.setattr(loop, "time", lambda: clock() + passed)
    monkeypatch.setattr(tcp, "POLITE", LONG)
    server = Server()
    listener = await listen("tcp:0", server.accept)
    clients = [Silent(listener.address), Silent(listener.address)]
    await until(lambda: len(server.endpoints) == 2)
    by_port = {endpoint.link.address.rpartition(":")[2]: endpoint.link for endpoint in server.endpoints}
    mute, reader = (by_port[str(client.socket.getsockname()[1])] for client in clients)
    for link in (mute, reader):
        await fill(link)
        assert link.statistics.waiting
        assert not link.congested
    said = reader.statistics.sent
    closing = asyncio.create_task(listener.close())
    read = 0
    while read < said or not server.reasons:
        read += len(clients[1].read())
        await settle()
    assert read == said
    assert not closing.done()
    passed = LONG
    await closing
    assert [type(reason) for reason in server.reasons] == [LinkClosed, LinkClosed]
    for client in clients:
        client.socket.close()


async def test_what_is_said_last_is_read_by_a_client_that_speaks_meanwhile() -> None:
    """A socket that is closed with unread bytes resets the connection, and what was not read is lost."""
    server = Server()
    listener = await listen("tcp:0", server.accept)
    client = Silent(listener.address)
    await until(lambda: bool(server.endpoints))
    (link,) = (endpoint.link for endpoint in server.endpoints)
    client.socket.send(b"unread")
    for number in range(100):
        link.send(b"%4d" % number)
    link.close()
    client.socket.send(b"nor this")
    read = b""
    while client.socket.fileno() >= 0:
        read += client.read()
        await settle()
    assert read == b"".join(b"%4d" % number for number in range(100))
    await until(lambda: bool(server.reasons))
    await listener.close()


async def test_an_ending_listener_ends_its_links_and_says_so() -> None:
    ends = RecordingHandlers()
    listener = await listen("tcp:0", ends)
    await connect(listener.address, ends)
    await until(lambda: len(ends) == 2)
    await listener.close()
    await until(lambda: all(each.reasons for each in ends))
    reasons = [reason for each in ends for reason in each.reasons]
    assert sorted(reason.by_us for reason in reasons if isinstance(reason, LinkClosed)) == [False, True]


async def test_a_connection_that_is_reset_before_it_is_looked_at_is_told_as_a_break(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop, ends = asyncio.get_running_loop(), RecordingHandlers()
    dial = loop.sock_connect

    async def turned_away(near: socket.socket, address: tuple[str, int]) -> None:
        await dial(near, address)
        far = rude.accept()[0]
        far.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        far.close()

    monkeypatch.setattr(loop, "sock_connect", turned_away)
    with socket.create_server(("127.0.0.1", 0)) as rude:
        address = f"tcp:127.0.0.1:{rude.getsockname()[1]}"
        link = await connect(address, ends)
    await until(lambda: ends[0].reasons)
    assert [type(reason) for reason in ends[0].reasons] == [LinkBroken]
    assert link.address == address


async def test_a_crowd_is_turned_away_at_the_door(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "MAX_LINKS", 5)
    server = Server()
    listener = await listen("tcp:0", server.accept)
    links = [Silent(listener.address) for _ in range(8)]
    await until(lambda: len(server.endpoints) == 5)
    await settle()
    assert len(listener.links) == 5
    links[0].socket.close()
    for each in links:
        each.socket.close()
    await until(lambda: not listener.links)
    late = Silent(listener.address)
    await until(lambda: len(server.endpoints) == 6)
    late.socket.close()
    await listener.close()


class Turnover(Server):
    """Serves one client at a time: who comes ends who was there, with a last word."""

    def __init__(self, last_word: bytes) -> None:
        super().__init__()
        self._last_word = last_word

    def accept(self, link: Link) -> Endpoint:
        for each in self.endpoints[-1:]:
            each.link.send(self._last_word)
            each.link.close()
        return super().accept(link)


@pytest.mark.parametrize("unread", [b"", bytes(tcp.HIGH_WATER)], ids=["silent", "unread"])
async def test_those_who_were_ended_keep_out_nobody(unread: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "MAX_LINKS", 5)
    monkeypatch.setattr(tcp, "SYSTEM_BUFFER", 4096)  # the last word stays with asyncio
    server = Turnover(unread)
    listener = await listen("tcp:0", server.accept)
    for come in range(20, 81, 20):
        links = [Silent(listener.address) for _ in range(20)]  # all before the loop has taken one step
        await until(lambda come=come: len(server.endpoints) == come)
        await settle()
        assert listener.links == {server.endpoints[-1].link}
        assert len(listener._links) <= tcp.MAX_LINKS
        for each in links:
            each.socket.close()
    await listener.close()


async def test_a_handler_that_cannot_be_made_ends_the_link() -> None:
    def accept(_: Link) -> RecordingHandler:
        raise RuntimeError("out of order")

    told: list[str] = []
    asyncio.get_running_loop().set_exception_handler(
        lambda _, context: told.append(str(context["exception"]))
    )
    listener = await listen("tcp:0", accept)
    client = Silent(listener.address)
    await until(lambda: told and not listener.links)
    assert told == ["out of order"]
    client.socket.close()
    await listener.close()
