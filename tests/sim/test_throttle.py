"""What a link brings beyond its share waits or is counted, and is never taken for newer than it is."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Endpoint, Frame, Parser
from robotree.protocol.errors import LinkClosed, LinkError
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.messages import (
    CommandInt,
    CommandLong,
    MavCmd,
    Message,
    Mode,
    ModeKind,
    Ping,
    SetMode,
    SysStatus,
)
from robotree.protocol.testing import until
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.kinds import kind
from robotree.sim.serving.throttle import (
    BURST,
    LARGEST_BACKLOG,
    LONGEST_FRAME,
    PIECE,
    Throttled,
    TokenBucket,
    stops_in,
)


class Listener:
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.data = b""
        self.stamps: set[int | None] = set()
        self.ended = False
        self._news = asyncio.Event()

    async def until(self, amount: int) -> None:
        while len(self.data) < amount:
            self._news.clear()
            await self._news.wait()

    def received(self, data: bytes, stops: int | None) -> None:
        assert not self.ended
        assert len(data) <= PIECE
        self.data += data
        self.stamps.add(stops)
        self._news.set()

    def closed(self, _: LinkError) -> None:
        self.ended = True


def _deaf(link: Link) -> Endpoint:
    return Endpoint(link, system=1, component=1, on_frame=lambda _: None)


class Bench:
    """A throttled link that cannot be paused, whose share is nearly nothing until it is given one."""

    def __init__(self) -> None:
        self.listener, self.stops, self.lost, self.share = Listener(), 3, 0, 1.0
        self.link = Loopback(self._accept, _deaf).near

    def _accept(self, link: Link) -> Throttled:
        self.throttled = Throttled(link, self.listener, lambda: self.share, lambda: self.stops, self._lose)
        return self.throttled

    def _lose(self) -> None:
        self.lost += 1


END = LinkClosed("loop:near", by_us=False)
DATAGRAM = bytes(range(256)) * 4


async def test_every_datagram_of_a_flood_is_heard_or_counted() -> None:
    bench = Bench()
    sent = 2 * int(BURST + LARGEST_BACKLOG) // len(DATAGRAM)
    bench.share = LARGEST_BACKLOG
    for _ in range(sent):
        bench.throttled.received(DATAGRAM)
    assert bench.lost > 0
    async with asyncio.timeout(60.0):
        await bench.listener.until((sent - bench.lost) * len(DATAGRAM))
    assert len(bench.listener.data) == (sent - bench.lost) * len(DATAGRAM)


def said(message: Message) -> bytes:
    return encode(message, sequence=0, system=9, component=1)


PING = said(Ping(0, 1))
STOPS = [
    said(SetMode(0, 0, 0, ModeKind.SAFE_STOP)),
    said(CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7)),
    said(CommandInt(1, 1, 0, MavCmd.DO_FLIGHTTERMINATION, 0, 0, 1.0, 0, 0, 0, 0, 0, 0)),
]
RELEASE = said(SetMode(0, 1, 1, ModeKind.READY))


@pytest.mark.parametrize("stop", STOPS, ids=["mode", "disarm", "terminate"])
@pytest.mark.parametrize("place", [0.0, 0.4, 1.0])
@given(cut=st.integers(0, len(PING)))
def test_of_what_waited_when_the_link_ended_the_stops_are_heard_and_little_else(
    stop: bytes, place: float, cut: int
) -> None:
    before = int(place * 2000)
    waited = (PING * before)[cut if before else 0 :] + stop + (PING * 200 + RELEASE) * (10 - before // 200)
    parser = Parser()
    parser.feed(PING[:cut] if before else b"")
    words = stops_in(waited, PIECE)
    assert len(words) <= PIECE
    messages = [frame.message for frame in parser.feed(words)]
    assert any(map(stop_asked_by, messages))
    assert len(messages) < 2 + LONGEST_FRAME / len(PING)


@given(st.binary(max_size=3 * LONGEST_FRAME))
def test_stops_in_anything_are_bounded_and_leave_no_frame_waiting(data: bytes) -> None:
    words = stops_in(data * 20, PIECE)
    assert len(words) <= PIECE
    parser = Parser()
    parser.feed(data)
    parser.feed(words)
    assert parser.flush() == []


async def test_a_stop_behind_the_flood_of_a_link_that_ends_is_heard_and_nothing_after_the_end() -> None:
    bench = Bench()
    bench.throttled.received(DATAGRAM * 100)
    bench.throttled.received(STOPS[0] + DATAGRAM * 100)
    told = len(bench.listener.data)
    bench.throttled.closed(END)
    assert STOPS[0] in bench.listener.data
    assert len(bench.listener.data) - told <= PIECE
    assert bench.lost == 1


async def test_a_link_that_ends_because_of_what_is_answered_is_heard_no_more() -> None:
    bench = Bench()
    heard = bench.listener.received

    def answer(data: bytes, stops: int | None) -> None:
        heard(data, stops)
        if len(bench.listener.data) == 2 * PIECE:
            bench.throttled.closed(END)

    bench.listener.received = answer  # type: ignore[method-assign]
    bench.throttled.received(DATAGRAM * 100)
    assert bench.listener.ended
    assert len(bench.listener.data) <= 3 * PIECE
    assert bench.throttled._later is None


async def test_who_begins_with_less_than_a_burst_is_heard_a_piece_at_once_and_then_at_its_share() -> None:
    bench = Bench()
    throttled = Throttled(bench.link, bench.listener, lambda: 1.0, lambda: 0, bench._lose, 0.0)
    throttled.received(DATAGRAM * 100)
    assert len(bench.listener.data) == PIECE
    throttled.closed(END)


async def test_what_waited_is_as_old_as_the_beginning_of_the_wait() -> None:
    bench = Bench()
    bench.throttled.received(DATAGRAM)
    assert bench.listener.stamps == {None}
    bench.throttled.received(DATAGRAM * 100)
    bench.stops = 9
    bench.throttled.received(DATAGRAM)
    bench.listener.stamps.clear()
    bench.throttled.closed(END)
    assert bench.listener.stamps == {3}


async def test_who_has_caught_up_is_heard_as_now_again() -> None:
    bench = Bench()
    bench.share = 10 * BURST
    bench.throttled.received(DATAGRAM * 100)
    bench.throttled.received(DATAGRAM)
    async with asyncio.timeout(60.0):
        await bench.listener.until(101 * len(DATAGRAM))
    bench.listener.stamps.clear()
    bench.throttled.received(DATAGRAM)
    await bench.listener.until(102 * len(DATAGRAM))
    assert bench.listener.stamps == {3}, "it may have waited in the system"
    await asyncio.sleep(0.2)
    bench.listener.stamps.clear()
    bench.throttled.received(DATAGRAM)
    assert bench.listener.stamps == {None}


async def test_a_release_behind_its_own_flood_does_not_undo_the_stop_of_another_link() -> None:
    controller = kind("rover").build(1, 2.0)

    class Client:
        """Bytes of a link, parsed and posted as a connection does."""

        def __init__(self) -> None:
            self.stops: int | None = None

        def received(self, data: bytes, stops: int | None) -> None:
            self.stops = stops
            endpoint.received(data)

        def closed(self, reason: LinkError) -> None:
            endpoint.closed(reason)

    def post(frame: Frame) -> None:
        controller.post(frame, "flooder", client.stops)

    client, bench = Client(), Bench()
    endpoint = Endpoint(bench.link, system=1, component=1, on_frame=post)
    throttled = Throttled(bench.link, client, lambda: BURST, lambda: controller.stops, lambda: None)
    throttled.received(bytes(int(BURST) + 8 * PIECE))
    throttled.received(encode(SetMode(0, 1, 1, ModeKind.READY), sequence=0, system=200, component=1))
    controller.post(Frame.of(SetMode(0, 1, 1, ModeKind.SAFE_STOP)), "other")
    told = [each.message for each in controller.advance() if isinstance(each.message, Mode)]
    assert {mode.mode for mode in told} == {ModeKind.SAFE_STOP}
    for _ in range(400):
        controller.advance()
    await until(lambda: endpoint.statistics.received == 1)
    for _ in range(400):
        controller.advance()
    assert controller.firmware.mode == ModeKind.SAFE_STOP


def test_what_was_lost_is_told() -> None:
    controller = kind("rover").build(1, 2.0)
    controller.greet("link")
    controller.firmware.gauges.lost = 7
    out = [each.message for _ in range(300) for each in controller.advance()]
    assert {each.errors_comm for each in out if isinstance(each, SysStatus)} == {7}


@given(
    amounts=st.lists(st.integers(1, 5000), max_size=50),
    pauses=st.lists(st.floats(0.0, 2.0), min_size=50, max_size=50),
)
def test_an_allowance_never_lets_more_through_than_burst_and_rate(
    amounts: list[int], pauses: list[float]
) -> None:
    burst, rate, now, spent = 4000.0, 1000.0, 0.0, 0
    bucket = TokenBucket(burst, now)
    for amount, pause in zip(amounts, pauses, strict=False):
        now += pause
        now += bucket.wait(rate, now)
        assert spent <= burst + rate * now + 1e-6
        bucket.spend(amount)
        spent += amount
