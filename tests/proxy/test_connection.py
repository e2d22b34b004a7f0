"""The shell around a session, over real sockets on this machine."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from robotree.protocol.errors import BadUrl
from robotree.protocol.links.url import listen
from robotree.protocol.messages import GoalState, Verb
from robotree.protocol.services.goal_client import GoalEnded
from robotree.proxy.connection import Connection
from robotree.proxy.errand import Desk, Errand, NotSent
from robotree.proxy.motion import Request
from robotree.proxy.session import Event, OnlineChanged, Session
from robotree.vr.testing import until

Controller = Any
GRIP = Request(Verb.GRIP, (0.02,))


@asynccontextmanager
async def running(work: Any) -> AsyncIterator[asyncio.Task[Any]]:
    task = asyncio.create_task(work)
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def pump(controller: Controller) -> None:
    loop = asyncio.get_running_loop()
    while True:
        controller.tick(loop.time())
        await asyncio.sleep(0.02)


class Bench:
    """A connection to one address, its desk, and all that it told."""

    def __init__(self, url: str) -> None:
        self.events: list[Event] = []
        self.session = Session()
        self.connection = Connection(url, self.session, on_event=self._hear, chance=random.Random(1))
        self.desk = Desk(self.connection)

    def send_out(self, key: int = 7) -> Errand:
        return self.desk.send_out(key, GRIP, epoch=5, ttl=0.0)

    def _hear(self, event: Event) -> None:
        self.events.append(event)
        self.desk.hear(event)


async def wait_for(errand: Errand) -> Any:
    assert await asyncio.to_thread(errand.wait, 5.0)
    return errand.end


async def test_a_dead_controller_is_dialled_until_it_lives(make_controller: type[Controller]) -> None:
    first = await listen("tcp:127.0.0.1:0", make_controller().accept)
    url = first.address
    await first.close()
    bench = Bench(url)
    async with running(bench.connection.run()):
        await until(lambda: "cannot be reached" in bench.session.trouble, "the trouble is told")
        assert "refused" in bench.session.trouble
        end = await wait_for(bench.send_out())
        assert end == NotSent(bench.session.trouble)
        controller = make_controller()
        second = await listen(url, controller.accept)
        async with running(pump(controller)):
            await until(lambda: bench.session.online, "it is found")
        await second.close()


async def test_a_controller_that_restarts_is_found_again(make_controller: type[Controller]) -> None:
    controller = make_controller()
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    bench = Bench(listener.address)
    async with running(bench.connection.run()), running(pump(controller)):
        await until(lambda: bench.session.online, "it is found")
        await listener.close()
        await until(lambda: not bench.session.online, "its end is noticed")
        assert "has closed the link" in bench.session.trouble
        listener = await listen(listener.address, controller.accept)
        await until(lambda: bench.session.online, "it is found")
        turns = [event.online for event in bench.events if isinstance(event, OnlineChanged)]
        assert turns == [True, False, True]
    await listener.close()


async def test_an_errand_from_another_thread_comes_back_with_its_end(
    make_controller: type[Controller],
) -> None:
    controller = make_controller()
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    bench = Bench(listener.address)
    async with running(bench.connection.run()), running(pump(controller)):
        await until(lambda: bench.session.online, "it is found")
        errand = await asyncio.to_thread(bench.send_out)
        await until(lambda: bool(controller.begun), "the goal arrives")
        controller.finish(GoalState.FAILED, text="It slipped.")
        end = await wait_for(errand)
        assert isinstance(end, GoalEnded)
        assert (end.state, end.text) == (GoalState.FAILED, "It slipped.")
    await listener.close()


async def test_a_recalled_errand_ends_at_the_controller(make_controller: type[Controller]) -> None:
    controller = make_controller()
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    bench = Bench(listener.address)
    async with running(bench.connection.run()), running(pump(controller)):
        await until(lambda: bench.session.online, "it is found")
        errand = bench.send_out()
        await until(lambda: bool(controller.begun), "the goal arrives")
        await asyncio.to_thread(bench.desk.recall, errand)
        end = await wait_for(errand)
        assert end.state == GoalState.CANCELLED
        assert controller.abandoned
    await listener.close()


async def test_no_errand_waits_for_a_proxy_that_has_ended(make_controller: type[Controller]) -> None:
    controller = make_controller()
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    bench = Bench(listener.address)
    async with running(bench.connection.run()), running(pump(controller)):
        await until(lambda: bench.session.online, "it is found")
        errand = bench.send_out()
        await until(lambda: bool(controller.begun), "the goal arrives")
    bench.desk.close("its proxy has ended")
    assert errand.end == NotSent("its proxy has ended")
    assert not bench.session.online
    await listener.close()


async def test_an_address_that_means_nothing_is_not_tried_again() -> None:
    with pytest.raises(BadUrl, match="begin it with"):
        await Bench("tpc:127.0.0.1:1").connection.run()


async def test_a_listener_that_never_speaks_is_not_hammered() -> None:
    class Mute:
        def received(self, data: bytes) -> None:
            pass

        def closed(self, reason: Exception) -> None:
            pass

    opened: list[Any] = []

    def accept(link: Any) -> Mute:
        opened.append(link)
        link.close()
        return Mute()

    listener = await listen("tcp:127.0.0.1:0", accept)
    bench = Bench(listener.address)
    async with running(bench.connection.run()):
        await asyncio.sleep(1.0)
        assert 2 <= len(opened) <= 6, "the waits between attempts grow although the link opens each time"
    await listener.close()
