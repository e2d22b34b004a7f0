"""What a link brings beyond its share waits or is counted, and is never taken for newer than it is."""

from __future__ import annotations

import asyncio

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Endpoint, Frame
from robotree.protocol.errors import LinkClosed, LinkError
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.messages import Mode, ModeKind, SetMode, SysStatus
from robotree.sim.kinds import kind
from robotree.sim.serving.allowance import Allowance
from robotree.sim.serving.throttle import BURST, LARGEST_BACKLOG, PIECE, Throttled


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
    for _ in range(sent):
        bench.throttled.received(DATAGRAM)
    bench.throttled.closed(END)
    assert bench.listener.ended
    assert bench.lost > 0
    assert len(bench.listener.data) == (sent - bench.lost) * len(DATAGRAM)


async def test_what_waited_when_the_link_ended_is_heard_before_its_end() -> None:
    bench = Bench()
    data = DATAGRAM * 100
    bench.throttled.received(data)
    assert len(bench.listener.data) < len(data)
    bench.throttled.closed(END)
    assert bench.listener.data == data
    assert bench.lost == 0


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
    async with asyncio.timeout(10.0):
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
    throttled = Throttled(bench.link, client, lambda: 1.0, lambda: controller.stops, lambda: None)
    throttled.received(bytes(int(BURST) + PIECE))
    throttled.received(encode(SetMode(0, 1, 1, ModeKind.READY), sequence=0, system=200, component=1))
    controller.post(Frame.of(SetMode(0, 1, 1, ModeKind.SAFE_STOP)), "other")
    told = [each.message for each in controller.advance() if isinstance(each.message, Mode)]
    assert {mode.mode for mode in told} == {ModeKind.SAFE_STOP}
    for _ in range(400):
        controller.advance()
    throttled.closed(END)
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
    allowance = Allowance(burst, now)
    for amount, pause in zip(amounts, pauses, strict=False):
        now += pause
        now += allowance.wait(rate, now)
        assert spent <= burst + rate * now + 1e-6
        allowance.spend(amount)
        spent += amount
