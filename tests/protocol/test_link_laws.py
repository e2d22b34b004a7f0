"""The laws of links, the same for every scheme; of what waits for one, and of the link for tests."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import count
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.errors import LinkBroken
from robotree.protocol.links.can import host as can_host
from robotree.protocol.links.can import listener as can_listener
from robotree.protocol.links.link import LinkStatistics
from robotree.protocol.links.loopback import Faults, Loopback
from robotree.protocol.links.outbox import Outbox
from robotree.protocol.links.url import SCHEMES, connect, listen
from robotree.protocol.testing import (
    RecordingHandler,
    check_close_in_accept,
    check_link,
    check_refused,
    until,
)

if TYPE_CHECKING:
    from robotree.protocol.links.link import Accept, Link, Listener

_CHANNELS = count()


@asynccontextmanager
async def sockets(url: str) -> AsyncGenerator[Callable[[Accept, Accept], Awaitable[tuple[Link, Link]]]]:
    """A way to make pairs over whatever can be listened on."""
    async with AsyncExitStack() as stack:

        async def make_pair(near: Accept, far: Accept) -> tuple[Link, Link]:
            listener: Listener = await listen(url, far)
            stack.push_async_callback(listener.close)
            link = await connect(listener.address, near)
            stack.callback(link.close)
            if url.startswith("udp"):
                link.send(b"a word, for nobody is known before")
            await until(lambda: listener.links)
            return link, next(iter(listener.links))

        yield make_pair


BUSES = ("robotree/?fd=1", "robotree/?fd=0", "virtual/?fd=1", "virtual/?fd=0")


def bus(kind: str) -> str:
    """A bus that nobody else uses."""
    return f"can:{kind.replace('?', f'laws-{os.getpid()}-{next(_CHANNELS)}?')}"


async def test_tcp_keeps_the_laws() -> None:
    async with sockets("tcp:0") as make_pair:
        await check_link(make_pair, lambda: asyncio.sleep(0.005), pauses=True)


async def test_udp_keeps_the_laws_that_datagrams_can_keep() -> None:
    async with sockets("udp:0") as make_pair:
        await check_link(make_pair, lambda: asyncio.sleep(0.005), congests=False, tells_the_end=False)


@pytest.mark.parametrize("kind", BUSES)
async def test_can_keeps_the_laws_classic_and_fd_watched_and_in_threads(kind: str) -> None:
    async with sockets(bus(kind)) as make_pair:
        await check_link(make_pair, lambda: asyncio.sleep(0.06))


async def test_a_serial_line_keeps_the_laws_that_a_line_can_keep(make_cable: Callable[[], Any]) -> None:
    cable = make_cable()

    async def make_pair(near: Accept, far: Accept) -> tuple[Link, Link]:
        listener = await listen(cable.url(1), far)
        link = await connect(cable.url(0), near)
        return link, next(iter(listener.links))

    await check_link(make_pair, lambda: asyncio.sleep(0.02), tells_the_end=False)


@pytest.mark.parametrize("pace", [1, 7], ids=["idle", "busy"])
async def test_loopback_keeps_the_laws_on_an_idle_machine_and_on_a_busy_one(pace: int) -> None:
    networks: list[Loopback] = []
    settlings = count(1)

    async def make_pair(near: Accept, far: Accept) -> tuple[Link, Link]:
        networks.append(Loopback(near, far))
        return networks[0].near, networks[0].far

    async def settle() -> None:
        if next(settlings) % pace == 0:  # else others had the processor
            networks[0].advance()

    await check_link(make_pair, settle, congests=False)


@pytest.mark.parametrize("end", ["who listens", "who connects"])
@pytest.mark.parametrize("scheme", sorted(SCHEMES))
async def test_a_link_may_be_closed_before_it_is_accepted(
    scheme: str, end: str, make_cable: Callable[[], Any]
) -> None:
    async with AsyncExitStack() as stack:
        here, there = f"{scheme}:0", ""
        if scheme == "can":
            here = bus("robotree/?fd=1")
        elif scheme == "serial":
            cable = make_cable()
            here, there = cable.url(1), cable.url(0)

        async def dial(accept: Accept) -> None:
            near, far = (RecordingHandler, accept) if end == "who listens" else (accept, RecordingHandler)
            listener = await listen(here, far)
            stack.push_async_callback(listener.close)
            link = await connect(there or listener.address, near)
            stack.callback(link.close)
            link.send(b"a word, for nobody is known before")
            if end == "who listens":
                await asyncio.sleep(0.05)
                assert listener.links == frozenset(), "what has ended is not open"

        await check_close_in_accept(dial, lambda: asyncio.sleep(0.06))


async def test_an_end_of_the_loopback_may_be_closed_before_it_is_accepted() -> None:
    networks: list[Loopback] = []

    async def dial(accept: Accept) -> None:
        networks.append(Loopback(RecordingHandler, accept))

    async def settle() -> None:
        networks[0].advance()

    await check_close_in_accept(dial, settle)


NOBODY = {
    "can": "can:robotree/laws-of-nobody",
    "serial": "serial:/dev/there-is-none",
    "tcp": "tcp:127.0.0.1:1",
}


@pytest.mark.parametrize("scheme", sorted(set(SCHEMES) - {"udp"}))
async def test_a_link_that_cannot_be_had_is_refused_in_one_sentence(
    scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_host, "CONNECT_TIMEOUT", 0.3)
    await check_refused(lambda accept: connect(NOBODY[scheme], accept))


@pytest.mark.parametrize("url", ["tcp:0", "udp:0", "can:robotree/"])
async def test_a_place_that_is_taken_is_refused_in_one_sentence(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = bus("robotree/?fd=1") if url.startswith("can") else url
    async with AsyncExitStack() as stack:
        first = await listen(url, lambda _: pytest.fail("nobody comes"))
        stack.push_async_callback(first.close)
        monkeypatch.setattr(can_listener, "CLAIM_TIME", 60.0)  # the other one answers, sooner or later
        await check_refused(lambda accept: listen(first.address, accept))


frames = st.lists(st.tuples(st.binary(min_size=1, max_size=9), st.sampled_from([None, "tool", "joints"])))


def _drain(box: Outbox) -> list[bytes]:
    drained = []
    while (frame := box.pop()) is not None:
        drained.append(frame)
    return drained


@given(frames)
def test_what_has_no_topic_is_never_dropped_and_keeps_its_order(sent: list[tuple[bytes, str | None]]) -> None:
    box = Outbox()
    for i, (frame, topic) in enumerate(sent):
        box.put(bytes((i % 256,)) + frame if topic is None else b"telemetry", topic)
    urgent = [bytes((i % 256,)) + frame for i, (frame, topic) in enumerate(sent) if topic is None]
    assert [frame for frame in _drain(box) if frame != b"telemetry"] == urgent


@given(frames)
def test_of_each_topic_only_the_newest_waits(sent: list[tuple[bytes, str | None]]) -> None:
    box = Outbox()
    for frame, topic in sent:
        box.put(frame, topic)
    newest = {topic: frame for frame, topic in sent if topic is not None}
    urgent = [frame for frame, topic in sent if topic is None]
    assert box.waiting == sum(map(len, [*newest.values(), *urgent]))
    assert box.superseded == len(sent) - len(urgent) - len(newest)
    assert sorted(_drain(box)) == sorted([*newest.values(), *urgent])
    assert box.waiting == 0


@given(frames, st.integers(0, 60))
def test_an_outbox_that_outgrows_its_bound_says_so_and_counts_what_left(
    sent: list[tuple[bytes, str | None]], bound: int
) -> None:
    box = Outbox(bound)
    for frame, topic in sent:
        box.put(frame, topic)
        overrun = box.overrun("tcp:far")
        assert (overrun is not None) == (box.waiting > bound)
        if overrun is not None:
            assert (overrun.address, overrun.waiting) == ("tcp:far", box.waiting)
    waited = box.waiting
    drained = _drain(box)
    assert box.statistics(7) == LinkStatistics(
        sent=sum(map(len, drained)), received=0, waiting=7, superseded=len(sent) - len(drained), dropped=0
    )
    assert box.statistics().sent == waited
    assert box.overrun("tcp:far") is None


def test_a_newer_frame_takes_the_place_of_the_older_one() -> None:
    box = Outbox()
    for frame, topic in [(b"t1", "t"), (b"ack", None), (b"t2", "t")]:
        box.put(frame, topic)
    assert _drain(box) == [b"t2", b"ack"]


class Letters:
    """Hears single frames."""

    def __init__(self, network: Loopback | None = None) -> None:
        self.network = network
        self.heard: list[tuple[float, bytes]] = []
        self.reasons: list[Exception] = []

    def received(self, data: bytes) -> None:
        assert self.network is not None
        self.heard.append((self.network.now, data))

    def closed(self, reason: Exception) -> None:
        self.reasons.append(reason)


def _play(faults: Faults, frames: int = 500) -> tuple[Letters, Loopback]:
    letters = Letters()
    network = Loopback(lambda _: Letters(), lambda _: letters, faults)
    letters.network = network
    for i in range(frames):
        network.advance(i * 0.01)
        network.near.send(i.to_bytes(2, "big"))
    network.advance(1000.0)
    return letters, network


def test_the_same_seed_gives_the_same_accidents() -> None:
    faults = Faults(loss=0.1, duplication=0.1, delay=0.05, jitter=0.05, seed=3)
    assert _play(faults)[0].heard == _play(faults)[0].heard
    assert _play(faults)[0].heard != _play(Faults(loss=0.1, seed=4))[0].heard


def test_frames_arrive_when_they_are_due() -> None:
    letters, _ = _play(Faults(delay=0.25), frames=3)
    assert [moment for moment, _ in letters.heard] == pytest.approx([0.25, 0.26, 0.27])


@pytest.mark.parametrize(("loss", "expected"), [(0.0, 500), (1.0, 0)])
def test_loss(loss: float, expected: int) -> None:
    assert len(_play(Faults(loss=loss))[0].heard) == expected


def test_jitter_lets_frames_overtake_each_other_and_loses_none() -> None:
    data = [frame for _, frame in _play(Faults(jitter=0.1))[0].heard]
    assert data != sorted(data)
    assert sorted(data) == [i.to_bytes(2, "big") for i in range(500)]


def test_duplication_brings_some_frames_twice() -> None:
    data = [frame for _, frame in _play(Faults(duplication=0.5))[0].heard]
    assert 700 < len(data) < 800
    assert len(set(data)) == 500


def test_a_cut_breaks_both_ends_and_loses_what_is_under_way() -> None:
    near, far = Letters(), Letters()
    network = Loopback(lambda _: near, lambda _: far, Faults(delay=1.0))
    network.near.send(b"lost")
    network.cut()
    network.advance(10.0)
    assert far.heard == []
    assert [type(reason) for reason in (*near.reasons, *far.reasons)] == [LinkBroken, LinkBroken]
    network.near.send(b"too late")
    assert network.near.statistics.dropped == 1


def test_ends_are_told_apart() -> None:
    network = Loopback(RecordingHandler, RecordingHandler)
    assert network.near.address != network.far.address
    assert not network.near.congested
