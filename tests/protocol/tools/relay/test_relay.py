"""The relay between real programs: a client and the simulated arm, over TCP and over CAN."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkClosed, LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Faults
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import Ping
from robotree.protocol.tools.relay import Relay, relaying


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


async def test_a_relay_joins_tcp_with_can(unused_channel: str) -> None:
    async def story(_relay: Relay, near: Ear, far: Ear) -> None:
        near.mouths[0].send(Ping(1, 1))
        await far.until(lambda: bool(far.frames))
        assert far.frames[0].message == Ping(1, 1)

    await pair(f"can:robotree/{unused_channel}?fd=1", Faults(), story)
