"""The shell around a session, over real sockets on this machine."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.protocol.errors import BadUrl
from robotree.protocol.links.link import Link, Listener
from robotree.protocol.links.url import listen
from robotree.protocol.messages import GoalState, Verb
from robotree.protocol.services.goal_client import GoalEnded
from robotree.proxy.connection import Connection
from robotree.proxy.motion import Request
from robotree.proxy.pending_goals import NotSent, OutcomeLost, PendingGoal, PendingGoals
from robotree.proxy.session import ControllerSession, SessionEvent
from robotree.vr.world.testing import until

Controller = Any
COMMAND: Any = SimpleNamespace(cancelled=False, context=SimpleNamespace(epoch=5), wake=lambda: None)
GRIP = Request(Verb.GRIP, (0.02,))


@asynccontextmanager
async def running(work: Any) -> AsyncIterator[asyncio.Task[Any]]:
    task = asyncio.create_task(work)
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class Bench:
    """A connection to one address, its desk, and all that it told."""

    def __init__(self, url: str) -> None:
        self.events: list[SessionEvent] = []
        self.session = ControllerSession()
        self.connection = Connection(url, self.session, on_event=self._hear, chance=random.Random(1))
        self.pending = PendingGoals(self.connection)

    def start(self, key: int = 7) -> PendingGoal:
        return self.pending.start(key, GRIP, activity=COMMAND, ttl=0.0, repeatable=False)

    def _hear(self, event: SessionEvent) -> None:
        self.events.append(event)
        self.pending.handle(event)


@asynccontextmanager
async def talking(controller: Controller) -> AsyncIterator[tuple[Bench, Listener]]:
    """A connection that has found its controller, and where that one listens."""
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    bench = Bench(listener.address)
    async with running(bench.connection.run()), running(controller.live()):
        await until(lambda: bench.session.online, "it is found")
        yield bench, listener
    await listener.close()


async def wait_for(pending: PendingGoal) -> Any:
    assert await asyncio.to_thread(pending.wait, 5.0)
    return pending.end


@pytest.fixture
def controller(make_controller: type[Controller]) -> Controller:
    return make_controller()


async def test_a_dead_controller_is_dialled_until_it_lives(controller: Controller) -> None:
    first = await listen("tcp:127.0.0.1:0", controller.accept)
    url = first.address
    await first.close()
    bench = Bench(url)
    async with running(bench.connection.run()):
        await until(lambda: "cannot be reached" in bench.session.trouble, "the trouble is told")
        assert "refused" in bench.session.trouble
        end = await wait_for(bench.start())
        assert end == NotSent(bench.session.trouble)
        second = await listen(url, controller.accept)
        async with running(controller.live()):
            await until(lambda: bench.session.online, "it is found")
        await second.close()


async def test_who_reads_that_it_is_offline_reads_that_it_is_back(
    controller: Controller, caplog: pytest.LogCaptureFixture
) -> None:
    async with talking(controller) as (bench, listener):
        assert caplog.messages == [], "what is expected is no news"
        for link in listener.links:
            link.close()
        await until(lambda: not bench.session.online, "it is missed")
        await until(lambda: bench.session.online, "it is back")
    assert [message.rpartition(": ")[2] for message in caplog.messages[1:2]] == ["online"]
    assert "offline" in caplog.messages[0]


async def test_a_goal_from_another_thread_ends_with_its_result(controller: Controller) -> None:
    async with talking(controller) as (bench, _):
        pending = await asyncio.to_thread(bench.start)
        await until(lambda: bool(controller.begun), "the goal arrives")
        controller.finish(GoalState.FAILED, text="It slipped.")
        end = await wait_for(pending)
        assert isinstance(end, GoalEnded)
        assert (end.state, end.text) == (GoalState.FAILED, "It slipped.")


async def test_no_goal_waits_for_a_proxy_that_has_ended(controller: Controller) -> None:
    async with talking(controller) as (bench, _):
        pending = bench.start()
        await until(lambda: bool(controller.begun), "the goal arrives")
    bench.pending.close("its proxy has ended")
    assert pending.end == OutcomeLost("its proxy has ended")
    assert not bench.session.online


async def test_an_address_that_means_nothing_is_not_tried_again() -> None:
    with pytest.raises(BadUrl, match="begin it with"):
        await Bench("tpc:127.0.0.1:1").connection.run()


async def test_a_listener_that_hangs_up_at_once_is_not_hammered() -> None:
    opened: list[float] = []

    class Mute:
        def received(self, data: bytes) -> None:
            pass

        def closed(self, reason: Exception) -> None:
            pass

    def accept(link: Link) -> Mute:
        opened.append(asyncio.get_running_loop().time())
        link.close()
        return Mute()

    listener = await listen("tcp:127.0.0.1:0", accept)
    async with running(Bench(listener.address).connection.run()):
        await until(lambda: len(opened) > 3, "it is dialled again and again")
    waits = [later - earlier for earlier, later in pairwise(opened)]
    # half of each doubled wait at least, though the link opens each time; a loop's clock is a little coarse
    assert all(wait > 0.9 * 0.5 * 0.1 * 2**n for n, wait in enumerate(waits))
    await listener.close()
