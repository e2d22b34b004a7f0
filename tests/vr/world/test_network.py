"""The accidents of the network in virtual time."""

from __future__ import annotations

import asyncio
import math
import random

import pytest

from robotree.vr.base.errors import NoAnswer, Unreachable
from robotree.vr.base.transport import Incoming, Respond, on_loop
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.promises import replies_of
from robotree.vr.world.testing import in_virtual_time

KEY = "robot/a/1"


class Echo:
    """Serves one key and remembers what it was asked."""

    def __init__(self, transport: MemoryTransport) -> None:
        self.transport = transport
        self.asked: list[bytes] = []

    async def open(self) -> None:
        await self.transport.serve(KEY, on_loop(self._answer))
        await self.transport.announce(KEY)

    async def _answer(self, body: bytes, respond: Respond) -> None:
        self.asked.append(body)
        respond(body)


async def pair(delay: float = 0.01) -> tuple[MemoryNetwork, Echo, MemoryTransport, list[tuple[str, bool]]]:
    """A server, a caller, and what the caller sees come and go."""
    network = MemoryNetwork(delay=delay, chance=random.Random(1).random)
    server, caller = Echo(network.join("server")), network.join("caller")
    seen: list[tuple[str, bool]] = []
    caller.presence.watch("robot/**", lambda key, there: seen.append((key, there)))
    await server.open()
    await asyncio.sleep(0.1)
    assert seen == [(KEY, True)]
    return network, server, caller, seen


@in_virtual_time
async def test_a_paused_process_reads_what_waits_when_it_goes_on() -> None:
    network, server, caller, seen = await pair()
    network.pause(server.transport)
    late = asyncio.create_task(replies_of(caller.request(KEY, b"late", timeout=0.5)))
    await asyncio.sleep(1.0)
    assert isinstance((await late)[1], NoAnswer)
    assert seen == [(KEY, True)]
    await asyncio.sleep(network.lease)
    assert seen[1:] == [(KEY, False)]
    (silent,) = await caller.presence.hanging("**")
    assert silent.asleep
    network.resume(server.transport)
    await asyncio.sleep(0.1)
    assert seen[2:] == [(KEY, True)]
    assert server.asked == [b"late"]


@pytest.mark.parametrize("who_asks_ends", [False, True])
@in_virtual_time
async def test_what_ends_something_is_left_in_the_socket_of_a_paused_process(*, who_asks_ends: bool) -> None:
    network, server, caller, seen = await pair()
    network.pause(server.transport)
    await asyncio.sleep(network.lease + 0.1)
    assert seen[1:] == [(KEY, False)]
    for asker in (caller, network.join("newcomer")):
        for void_at in (math.inf, 0.0, asyncio.get_running_loop().time() + 60.0):
            asking = asker.request(KEY, f"{asker.name} {void_at}".encode(), timeout=1.0, void_at=void_at)
            assert isinstance((await replies_of(asking))[1], Unreachable)
        if who_asks_ends:
            network.kill(asker)
    network.resume(server.transport)
    await asyncio.sleep(0.1)
    assert server.asked == [b"caller inf", b"newcomer inf"]


@pytest.mark.parametrize(("wakes_after", "ends_after", "answered"), [(10.0, 3.0, False), (2.5, 2.5, True)])
@in_virtual_time
async def test_a_server_that_hangs_is_waited_for_as_long_as_it_may_still_begin(
    wakes_after: float, ends_after: float, *, answered: bool
) -> None:
    loop = asyncio.get_running_loop()
    network, server, caller, _ = await pair()
    network.pause(server.transport)
    began = loop.time()
    loop.call_later(wakes_after, network.resume, server.transport)
    got = await replies_of(caller.request(KEY, b"x", timeout=60.0, void_at=began + 3.0))
    assert loop.time() - began == pytest.approx(ends_after, abs=0.1)
    assert got == ([b"x"], None) if answered else isinstance(got[1], Unreachable)
    began = loop.time()
    network.kill(server.transport)
    assert isinstance(
        (await replies_of(caller.request(KEY, b"x", timeout=60.0, void_at=began + 3.0)))[1], Unreachable
    )
    assert loop.time() - began < 0.1, "one that has ended is not waited for"


@in_virtual_time
async def test_one_that_is_heard_no_more_in_one_direction_still_hears() -> None:
    network, server, caller, seen = await pair()
    watched: list[bool] = []
    await caller.announce("caller")
    server.transport.presence.watch("caller", lambda _, there: watched.append(there))
    network.cut_one_way(server.transport, caller)
    asking = replies_of(caller.request(KEY, b"x", timeout=1.0))
    assert isinstance((await asking)[1], NoAnswer)
    assert server.asked == [b"x"]
    await asyncio.sleep(network.lease + 0.1)
    assert seen[1:] == [(KEY, False)]
    assert watched[-1]
    assert isinstance((await replies_of(caller.request(KEY, b"y", timeout=1.0)))[1], Unreachable)
    network.heal(server.transport, caller)
    await asyncio.sleep(0.1)
    assert await replies_of(caller.request(KEY, b"z", timeout=1.0)) == ([b"z"], None)


@in_virtual_time
async def test_a_connection_that_breaks_loses_the_reply_and_comes_back() -> None:
    network, server, caller, seen = await pair()
    asking = asyncio.create_task(replies_of(caller.request(KEY, b"x", timeout=5.0)))
    await asyncio.sleep(0.015)
    assert server.asked == [b"x"]
    network.reset(server.transport, caller)
    assert isinstance((await asking)[1], Unreachable)
    await asyncio.sleep(1.0)
    assert seen[1:] == [(KEY, False), (KEY, True)]
    assert await replies_of(caller.request(KEY, b"y", timeout=1.0)) == ([b"y"], None)


@in_virtual_time
async def test_a_machine_that_vanishes_is_noticed_after_its_lease_and_a_killed_process_at_once() -> None:
    network, server, caller, seen = await pair()
    network.vanish(server.transport)
    await asyncio.sleep(network.lease - 0.1)
    assert seen == [(KEY, True)]
    await asyncio.sleep(0.2)
    assert seen[1:] == [(KEY, False)]
    assert await caller.presence.hanging("**") == []
    other = Echo(network.join("other"))
    await other.open()
    await asyncio.sleep(0.1)
    network.kill(other.transport)
    await asyncio.sleep(0.02)
    assert seen[2:] == [(KEY, True), (KEY, False)]


@in_virtual_time
async def test_a_request_may_arrive_twice_and_its_reply_is_heard_once() -> None:
    network, server, caller, _ = await pair()
    network.weather.duplication = 1.0
    assert await replies_of(caller.request(KEY, b"x", timeout=1.0)) == ([b"x"], None)
    await asyncio.sleep(0.1)
    assert server.asked == [b"x", b"x"]


@in_virtual_time
async def test_messages_are_late_by_chance_and_keep_their_order_on_a_channel() -> None:
    network, server, caller, _ = await pair()
    network.weather.jitter = 0.5
    heard: list[bytes] = []
    await caller.subscribe("s", lambda _, body: heard.append(body))
    samples = [bytes([number]) for number in range(50)]
    for sample in samples:
        server.transport.publish("s", sample)
    await asyncio.sleep(1.0)
    assert heard == samples


@in_virtual_time
async def test_an_urgent_request_may_overtake_a_sample() -> None:
    network, server, caller, _ = await pair()
    network.weather.jitter = 0.5
    overtaken = 0
    for number in range(20):
        caller.publish("s", b"")
        body = bytes([number])
        order: list[str] = []
        subscription = await server.transport.subscribe("s", lambda *_, order=order: order.append("sample"))
        caller.publish("s", b"")
        await replies_of(caller.request(KEY, body, timeout=2.0, urgent=True))
        overtaken += "sample" not in order
        await subscription.close()
    assert overtaken > 0


@in_virtual_time
async def test_a_request_without_waiting_is_taken_directly_or_by_the_handler() -> None:
    network = MemoryNetwork(delay=0.01)
    server, caller = network.join("server"), network.join("caller")
    heard: list[bytes | None] = []

    async def slowly(body: bytes, respond: Respond) -> None:
        respond(b"slow " + body)

    def take(incoming: Incoming) -> None:
        if not incoming.body.startswith(b"d"):
            incoming.answer_on_loop(slowly)
            return
        incoming.reply(b"direct " + incoming.body)
        incoming.end(b"last")

    await server.serve(KEY, take)
    await asyncio.sleep(0.1)
    for body in (b"d", b"s"):
        caller.ask(KEY, body, on_reply=heard.append)
        await asyncio.sleep(0.1)
    assert heard == [b"direct d", b"last", None, b"slow s", None]
    caller.ask("nobody", b"d", on_reply=heard.append)
    await asyncio.sleep(0.1)
    assert heard[5:] == [None]


@pytest.mark.parametrize("accident", ["kill", "vanish", "pause", "freeze"])
@in_virtual_time
async def test_no_accident_harms_the_others(accident: str) -> None:
    network, server, caller, _ = await pair()
    victim = network.join("victim")
    await victim.announce("robot/v/1")
    getattr(network, accident)(victim)
    for _ in range(5):
        await asyncio.sleep(1.0)
        assert await replies_of(caller.request(KEY, b"x", timeout=1.0)) == ([b"x"], None)
    assert caller.presence.keys("**") == [KEY]
    assert server.asked == [b"x"] * 5
