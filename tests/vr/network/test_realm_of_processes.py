"""Real processes on one machine: killed, stopped, interrupted, and all at once."""

from __future__ import annotations

import asyncio
import shutil
import signal
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from robotree.vr.base.errors import NoAnswer, Unreachable
from robotree.vr.base.requests import AnyRequest, Delete, Describe, Done, SafeStop
from robotree.vr.exchange.asking import ask
from robotree.vr.network.local import LocalTransport
from robotree.vr.network.mesh import HANGS, TICK
from robotree.vr.world.promises import replies_of, until
from tests.vr.network.processes import Start

Enter = Callable[[], Awaitable[LocalTransport]]


async def arrived(transport: LocalTransport, name: str) -> None:
    async with asyncio.timeout(60):
        while not transport.presence.keys(f"robot/{name}/*"):  # noqa: ASYNC110 # what is asked is the test
            await asyncio.sleep(0.005)


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


async def test_a_stopped_process_is_silent_then_missed_then_back(start: Start, join_realm: Enter) -> None:
    process = await start("serve", "arm")
    await process.ready()
    transport = await join_realm()
    seen: list[bool] = []
    transport.presence.watch("robot/*/*", lambda _, there: seen.append(there))
    await arrived(transport, "arm")
    process.signal(signal.SIGSTOP)
    got = await replies_of(transport.request("robot/arm/1", b"", timeout=0.3))
    assert isinstance(got[1], NoAnswer)
    await until(lambda: seen == [True, False], "silence ends its presence")
    got = await replies_of(transport.request("robot/arm/1", b"", timeout=60))
    assert isinstance(got[1], Unreachable)
    process.signal(signal.SIGCONT)
    await until(lambda: seen == [True, False, True], "its presence returns with it")
    assert await replies_of(transport.request("robot/arm/1", b"hi", timeout=60)) == ([b"ack", b"hi"], None)


async def test_sixteen_at_once_all_know_each_other(start: Start, join_realm: Enter) -> None:
    crowd = [await start("serve", f"r{number}") for number in range(16)]
    await asyncio.gather(*(process.ready() for process in crowd))
    transport = await join_realm()
    expected = sorted(f"robot/r{number}/1" for number in range(16))
    seen: set[str] = set()
    transport.presence.watch("robot/*/*", lambda key, _: seen.add(key))
    await until(lambda: sorted(seen) == expected, "the newcomer sees all")
    results = await asyncio.gather(
        *(replies_of(transport.request(key, b"hi", timeout=10)) for key in expected)
    )
    assert results == [([b"ack", b"hi"], None)] * 16


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


@pytest.mark.speed
async def test_a_newcomer_that_is_paused_at_the_door_keeps_nobody_out(
    start: Start, join_realm: Enter, place: Path
) -> None:
    """Whatever it was about when it was stopped: others come, and it is complete when it goes on."""
    process = await start("serve", "arm")
    await process.ready()
    slow = await start("serve", "slow")
    folder = place / "robotree" / "test"
    while not list(folder.glob(f"*{slow.process.pid}-*")):  # noqa: ASYNC110 # the first that is seen of it
        await asyncio.sleep(0)
    slow.signal(signal.SIGSTOP)
    begin = time.perf_counter()
    transport = await join_realm()
    assert time.perf_counter() - begin < 1.0
    await arrived(transport, "arm")
    slow.signal(signal.SIGCONT)
    await slow.ready()
    await arrived(transport, "slow")


async def test_a_folder_that_was_removed_is_made_again_and_newcomers_see_all(
    start: Start, join_realm: Enter, place: Path
) -> None:
    process = await start("serve", "arm")
    await process.ready()
    early = await join_realm()
    await arrived(early, "arm")
    shutil.rmtree(place / "robotree" / "test")
    late = await join_realm()
    await arrived(late, "arm")
    assert await replies_of(late.request("robot/arm/1", b"hi", timeout=60)) == ([b"ack", b"hi"], None)
    assert await replies_of(early.request("robot/arm/1", b"hi", timeout=60)) == ([b"ack", b"hi"], None)


@pytest.mark.parametrize("seconds", [1.5, 2.0, 2.5, 3.5])
@pytest.mark.speed
async def test_a_process_that_slept_is_whole_again_within_a_second(
    seconds: float, start: Start, join_realm: Enter
) -> None:
    """Around every time limit there is: the beat that is missed, and the tick that comes late.

    Who asks may find it silent in the moment in which it wakes, and asks again: that takes milliseconds.
    """
    process = await start("serve", "arm")
    await process.ready()
    transport = await join_realm()
    await arrived(transport, "arm")
    process.signal(signal.SIGSTOP)
    await asyncio.sleep(seconds)
    process.signal(signal.SIGCONT)
    woken = time.perf_counter()
    await arrived(transport, "arm")
    answer = None
    while answer != ([b"ack", b"hi"], None) and time.perf_counter() < woken + 60:
        answer = await replies_of(transport.request("robot/arm/1", b"hi", timeout=60))
    assert time.perf_counter() - woken < 1.0  # measured: at most 0.05 s, on a machine at load 5


@pytest.mark.parametrize(("request_", "count"), [(Delete(), "1"), (Describe(), "1"), (SafeStop(), "2")])
async def test_of_what_was_asked_of_a_sleeper_only_what_ends_something_is_begun_after_its_time(
    start: Start, join_realm: Enter, request_: AnyRequest, count: str
) -> None:
    """A stop counts however late it comes."""
    process = await start("count", "arm")
    await process.ready()
    transport = await join_realm()
    await arrived(transport, "arm")
    await process.freeze()
    with pytest.raises(NoAnswer):
        await ask(transport, "robot/arm/1", request_, Done, timeout=0.2)
    process.signal(signal.SIGCONT)
    assert (await ask(transport, "robot/arm/1", request_, Done, timeout=60)).note == count


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


@pytest.mark.parametrize("times", range(3))
async def test_a_process_that_forgets_to_close_still_ends(
    times: int, start: Start, join_realm: Enter
) -> None:
    transport = await join_realm()
    await transport.subscribe("robot/**", lambda _key, _body: None)
    process = await start("leave-open", f"r{times}")
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
