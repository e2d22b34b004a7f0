"""The relay between real programs, over TCP and over CAN, and the joint that does what it was told."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Awaitable, Callable

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Parser, encode
from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Faults, Loopback
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import NamedValueFloat, Ping
from robotree.protocol.testing import RecordingHandler
from robotree.protocol.tools.relay import FaultyCable, Relay, relaying


class Ear:
    """Hears frames, and how its link ends."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.reasons: list[LinkError] = []
        self.changed = asyncio.Event()
        self.mouths: list[Endpoint] = []

    def accept(self, link: Link) -> Endpoint:
        self.mouths.append(Endpoint(link, system=1, component=1, on_frame=self._hear, on_closed=self._closed))
        self.changed.set()
        return self.mouths[-1]

    def _hear(self, frame: Frame) -> None:
        self.frames.append(frame)
        self.changed.set()

    def _closed(self, reason: LinkError) -> None:
        self.reasons.append(reason)
        self.changed.set()

    async def until(self, happened: Callable[[], bool]) -> None:
        async with asyncio.timeout(60):
            while not happened():
                self.changed.clear()
                await self.changed.wait()


Story = Callable[[Relay, "Ear", "Ear"], Awaitable[None]]


async def pair(url: str, faults: Faults, story: Story) -> None:
    near, far = Ear(), Ear()
    target = await listen(url, far.accept)
    async with relaying("tcp:127.0.0.1:0", target.address, faults) as relay:
        link = await connect(relay.address, near.accept)
        await story(relay, near, far)
        link.close()
    await target.close()


async def test_frames_pass_both_ways_and_are_counted() -> None:
    async def story(relay: Relay, near: Ear, far: Ear) -> None:
        for number in range(50):
            near.mouths[0].send(Ping(1, number))
        await far.until(lambda: len(far.frames) == 50)
        far.mouths[0].send(Ping(2, 7))
        await near.until(lambda: bool(near.frames))
        assert [frame.sequence for frame in far.frames] == list(range(50))
        assert (relay.traffic["near"].passed, relay.traffic["far"].passed) == (50, 1)

    await pair("tcp:127.0.0.1:0", Faults(), story)


async def test_a_delay_is_kept_by_the_clock() -> None:
    async def story(_relay: Relay, near: Ear, far: Ear) -> None:
        loop = asyncio.get_running_loop()
        began = loop.time()
        near.mouths[0].send(Ping(1, 1))
        await far.until(lambda: bool(far.frames))
        assert loop.time() - began >= 0.099

    await pair("tcp:127.0.0.1:0", Faults(delay=0.1), story)


async def test_when_one_side_ends_so_does_the_other() -> None:
    async def story(relay: Relay, near: Ear, far: Ear) -> None:
        near.mouths[0].send(Ping(1, 1))
        await far.until(lambda: bool(far.frames))
        far.mouths[0].link.close()
        await near.until(lambda: bool(near.reasons))
        assert isinstance(near.reasons[0], LinkClosed)
        assert relay.traffic["near"].passed == 1

    await pair("tcp:127.0.0.1:0", Faults(), story)


async def test_a_target_that_is_not_there_ends_the_link_that_came() -> None:
    near = Ear()
    nobody = await listen("tcp:127.0.0.1:0", near.accept)
    await nobody.close()
    async with relaying("tcp:127.0.0.1:0", nobody.address, Faults()) as relay:
        await connect(relay.address, near.accept)
        await near.until(lambda: bool(near.reasons))
        assert relay.refused == 1


async def test_who_comes_during_a_cut_is_cut_until_it_ends() -> None:
    async def story(relay: Relay, _near: Ear, far: Ear) -> None:
        relay.cut(600.0)
        late = Ear()
        link = await connect(relay.address, late.accept)
        await far.until(lambda: len(far.mouths) == 2)
        late.mouths[0].send(Ping(1, 1))
        link.close()
        await far.until(lambda: bool(far.reasons))
        assert (relay.traffic["near"].taken, relay.traffic["near"].passed) == (1, 0)
        assert 500.0 < relay.cut_left <= 600.0
        relay.cut(0.0)
        assert relay.cut_left == 0.0
        link = await connect(relay.address, late.accept)
        late.mouths[1].send(Ping(1, 2))
        await far.until(lambda: bool(far.frames))
        assert [frame.message for frame in far.frames] == [Ping(1, 2)]
        link.close()

    await pair("tcp:127.0.0.1:0", Faults(), story)


async def test_a_relay_joins_tcp_with_can() -> None:
    async def story(_relay: Relay, near: Ear, far: Ear) -> None:
        near.mouths[0].send(Ping(1, 1))
        await far.until(lambda: bool(far.frames))
        assert far.frames[0].message == Ping(1, 1)

    await pair(f"can:robotree/relay-{uuid.uuid4().hex[:12]}?fd=1", Faults(), story)


class Far:
    """A link of which only the far side matters: what was sent on it, at once."""

    def __init__(self) -> None:
        self.network = Loopback(RecordingHandler, self._accept)

    def _accept(self, link: object) -> RecordingHandler:
        self.heard = RecordingHandler(link)  # type: ignore[arg-type]  # any end will do
        return self.heard

    @property
    def sequences(self) -> list[int]:
        self.network.advance()
        return [frame.sequence for frame in Parser().feed(self.heard.data)]


def frame(number: int) -> bytes:
    message = NamedValueFloat(time_boot_ms=number, name="x", value=1.0)
    return encode(message, sequence=number, system=1, component=1)


def joined(faults: Faults) -> tuple[FaultyCable, Far, Far]:
    cable, near, far = FaultyCable(faults, 0.0), Far(), Far()
    cable.open("near", near.network.near)
    cable.open("far", far.network.near)
    return cable, near, far


@given(cut=st.integers(1, 60))
def test_without_faults_everything_passes_both_ways(cut: int) -> None:
    cable, near, far = joined(Faults())
    stream = b"".join(map(frame, range(20))) + b"noise"
    for i in range(0, len(stream), cut):
        cable.take("near", stream[i : i + cut], i)
        cable.take("far", stream[i : i + cut], i)
    assert far.sequences == near.sequences == list(range(20))
    assert far.heard.data == stream
    assert cable.traffic["near"].passed == cable.traffic["near"].taken


def test_a_lost_frame_is_lost_whole_and_the_others_are_not_touched() -> None:
    cable, _, far = joined(Faults(loss=0.3, seed=1))
    for number in range(200):
        cable.take("near", frame(number)[:7], number)
        cable.take("near", frame(number)[7:], number)
    found = far.sequences
    assert 110 <= len(found) <= 170
    assert Parser().feed(far.heard.data)[-1].sequence == found[-1]
    assert len(far.heard.data) == len(found) * len(frame(1))
    traffic = cable.traffic["near"]
    assert (traffic.taken, traffic.passed) == (200, len(found))


def test_the_same_seed_loses_the_same_frames() -> None:
    outcomes: list[list[int]] = []
    for _ in range(2):
        cable, _, far = joined(Faults(loss=0.5, seed=7))
        for number in range(50):
            cable.take("near", frame(number), number)
        outcomes.append(far.sequences)
    assert outcomes[0] == outcomes[1]


def test_a_delayed_frame_comes_when_it_is_due() -> None:
    cable, _, far = joined(Faults(delay=0.5))
    cable.take("near", frame(0), 1.0)
    assert cable.due == 1.5
    cable.advance(1.49)
    assert far.sequences == []
    cable.advance(1.5)
    assert far.sequences == [0]
    assert cable.due is None


def test_nothing_passes_while_the_cable_is_cut_and_everything_after() -> None:
    cable, near, far = joined(Faults())
    for number in range(20):
        if number == 10:
            cable.cut(13.0)
        cable.take("near", frame(number), number)
        cable.take("far", frame(number), number)
    assert near.sequences == far.sequences == [*range(10), *range(13, 20)]


def test_faults_change_while_it_runs() -> None:
    cable, _, far = joined(Faults(loss=1.0))
    cable.take("near", frame(0), 0.0)
    cable.faults = Faults()
    cable.take("near", frame(1), 1.0)
    cable.faults = Faults(duplication=1.0)
    cable.take("near", frame(2), 2.0)
    assert far.sequences == [1, 2, 2]


def test_what_comes_before_the_far_link_is_open_waits_for_it() -> None:
    cable, far = FaultyCable(Faults(), 0.0), Far()
    cable.take("near", frame(0) + frame(1), 0.0)
    cable.open("far", far.network.near)
    cable.take("near", frame(2), 0.1)
    assert far.sequences == [0, 1, 2]


@given(st.lists(st.tuples(st.sampled_from(["near", "far"]), st.binary(max_size=300)), max_size=20))
def test_no_bytes_raise_and_none_are_added(pieces: list[tuple[str, bytes]]) -> None:
    cable, near, far = joined(Faults())
    for now, (side, data) in enumerate(pieces):
        cable.take(side, data, now)
    near.network.advance()
    far.network.advance()
    for side, other in (("near", far), ("far", near)):
        sent = b"".join(data for name, data in pieces if name == side)
        assert sent.startswith(other.heard.data)


def test_an_end_that_has_gone_is_nothing_that_raises() -> None:
    cable, _, far = joined(Faults())
    far.network.cut()
    far.network.advance()
    cable.take("near", frame(0), 0.0)
    assert [type(reason) for reason in far.heard.reasons] == [LinkBroken]
