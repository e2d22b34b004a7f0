"""Real processes on one machine: killed, stopped, interrupted, and all at once."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from robotree.vr.base.errors import Unreachable
from robotree.vr.network.local import LocalTransport
from robotree.vr.network.mesh import HANGS, TICK
from robotree.vr.world.promises import replies_of, until
from tests.vr.network.processes import Start, start_all

Enter = Callable[[], Awaitable[LocalTransport]]


async def arrived(transport: LocalTransport, name: str) -> None:
    async with asyncio.timeout(60):
        while not transport.presence.keys(f"robot/{name}/*"):  # noqa: ASYNC110 # what is asked is the test
            await asyncio.sleep(0.005)


@pytest.mark.speed
async def test_a_killed_process_is_missed_at_once(start: Start, join_realm: Enter) -> None:
    process = await start("serve", "arm")
    await process.ready()
    transport = await join_realm()
    gone: list[float] = []
    transport.presence.watch(
        "robot/*/*", lambda _, there: None if there else gone.append(time.perf_counter())
    )
    await arrived(transport, "arm")
    waiting = transport.request("robot/arm/1", b"long", timeout=30)
    assert await anext(waiting) == b"ack"
    killed = time.perf_counter()
    process.signal(signal.SIGKILL)
    assert await replies_of(waiting) == ([], None), "what it had begun to answer just ends"
    await until(lambda: bool(gone), "it is missed")
    assert gone[0] - killed < 0.5  # measured: 3 ms
    got = await replies_of(transport.request("robot/arm/1", b"", timeout=60))
    assert isinstance(got[1], Unreachable)


@pytest.mark.speed
async def test_the_files_of_the_dead_are_removed_by_the_next_who_comes(
    start: Start, join_realm: Enter, place: Path
) -> None:
    dead = [await start("serve", f"r{number}") for number in range(4)]
    for process in dead:
        await process.ready()
        process.signal(signal.SIGKILL)
        await process.process.wait()
    begin = time.perf_counter()
    transport = await join_realm()
    assert time.perf_counter() - begin < 1.0
    folder = place / "robotree" / "test"
    tag = transport.mesh.place.tag
    assert {path.name for path in folder.iterdir()} == {f"{tag}.sock", f"{tag}.beat", f"{tag}.held"}
    await transport.close()
    assert list(folder.iterdir()) == []


async def test_a_process_that_hangs_is_waited_for_as_long_as_it_may_still_begin(
    start: Start, join_realm: Enter
) -> None:
    process = await start("serve", "arm")
    await process.ready()
    transport = await join_realm()
    await arrived(transport, "arm")
    await process.freeze()
    began = time.monotonic()
    asking, given_up = (
        asyncio.ensure_future(
            replies_of(transport.request("robot/arm/1", b"hi", timeout=60, void_at=began + seconds))
        )
        for seconds in (60.0, 0.5)
    )
    assert isinstance((await given_up)[1], Unreachable)
    assert time.monotonic() - began > HANGS - 2 * TICK
    assert not transport.presence.keys("robot/arm/1")
    process.signal(signal.SIGCONT)
    assert await asking == ([b"ack", b"hi"], None)


async def test_a_process_that_forgets_to_close_still_ends(start: Start, join_realm: Enter) -> None:
    transport = await join_realm()
    await transport.subscribe("robot/**", lambda _key, _body: None)
    process = await start("leave-open", "arm")
    await process.ready()
    assert await process.end() == (0, "")


async def test_an_interrupt_ends_a_process_without_a_word(start: Start, join_realm: Enter) -> None:
    transport = await join_realm()
    await transport.subscribe("robot/**", lambda _key, _body: None)
    process = await start("wait-for-interrupt", "arm")
    await process.ready()
    await arrived(transport, "arm")
    process.signal(signal.SIGINT)
    assert await process.end() == (130, "")


async def test_members_end_in_order_when_their_tether_is_cut(start: Start) -> None:
    for member in await start_all(start, ("lookup", "l1"), ("host", "h1"), ("robot", "rover")):
        assert await member.end() == (0, "")
