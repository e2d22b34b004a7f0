"""Real processes over real Zenoh: killed, stopped, interrupted, and all at once."""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robotree.vr.errors import NoAnswer, Unreachable
from robotree.vr.network.zenoh import ZenohTransport, join
from robotree.vr.network.zenoh_session import Session
from robotree.vr.rehearsal.promises import replies_of, until
from robotree.vr.transport import Respond

Start = Callable[..., Awaitable[Any]]
Enter = Callable[[], Awaitable[ZenohTransport]]


async def arrived(transport: ZenohTransport, name: str) -> None:
    async with asyncio.timeout(60):
        while not await transport.present(f"robot/{name}/*"):  # noqa: ASYNC110 # what is asked is the test
            await asyncio.sleep(0.005)


async def cancelled_twice(doing: Coroutine[None, None, Any], begun: asyncio.Future[None]) -> None:
    """By a time limit, say, and by the end of the program, while a thread is still about it."""
    task = asyncio.ensure_future(doing)
    await begun
    for _ in range(2):
        task.cancel()
        await asyncio.wait([task], timeout=0)  # it begins to wait for the thread, and then no longer
    assert task.cancelled()


async def test_a_killed_process_is_missed_at_once(start: Start, join_zenoh: Enter) -> None:
    process = await start("serve", "arm")
    await process.ready()
    transport = await join_zenoh()
    gone: list[float] = []
    await transport.watch("robot/*/*", lambda _, there: None if there else gone.append(time.perf_counter()))
    await arrived(transport, "arm")
    waiting = transport.request("robot/arm/1", b"long", timeout=30)
    assert await anext(waiting) == b"ack"
    killed = time.perf_counter()
    process.signal(signal.SIGKILL)
    assert await replies_of(waiting) == ([], None), "what it had begun to answer just ends"
    await until(lambda: bool(gone), "it is missed")
    assert gone[0] - killed < 0.5  # measured: 60 ms, 50 of which are the wait for its return
    got = await replies_of(transport.request("robot/arm/1", b"", timeout=5))
    assert isinstance(got[1], Unreachable)


async def test_a_stopped_process_is_silent_then_missed_then_back(start: Start, join_zenoh: Enter) -> None:
    process = await start("serve", "arm")
    await process.ready()
    transport = await join_zenoh()
    seen: list[bool] = []
    await transport.watch("robot/*/*", lambda _, there: seen.append(there))
    await arrived(transport, "arm")
    process.signal(signal.SIGSTOP)
    got = await replies_of(transport.request("robot/arm/1", b"", timeout=0.3))
    assert isinstance(got[1], NoAnswer)
    await until(lambda: seen == [True, False], "silence ends its presence")
    got = await replies_of(transport.request("robot/arm/1", b"", timeout=5))
    assert isinstance(got[1], Unreachable)
    process.signal(signal.SIGCONT)
    await until(lambda: seen == [True, False, True], "its presence returns with it")
    assert await replies_of(transport.request("robot/arm/1", b"hi", timeout=5)) == ([b"ack", b"hi"], None)


async def test_sixteen_at_once_all_know_each_other(start: Start, join_zenoh: Enter) -> None:
    crowd = [await start("serve", f"r{number}") for number in range(16)]
    await asyncio.gather(*(process.ready() for process in crowd))
    transport = await join_zenoh()
    expected = sorted(f"robot/r{number}/1" for number in range(16))
    seen: set[str] = set()
    await transport.watch("robot/*/*", lambda key, _: seen.add(key))
    await until(lambda: sorted(seen) == expected, "the newcomer sees all")
    results = await asyncio.gather(
        *(replies_of(transport.request(key, b"hi", timeout=10)) for key in expected)
    )
    assert results == [([b"ack", b"hi"], None)] * 16


async def test_the_dead_are_swept_out_by_the_next_who_comes(
    start: Start, join_zenoh: Enter, place: Path
) -> None:
    dead = [await start("serve", f"r{number}") for number in range(4)]
    for process in dead:
        await process.ready()
        process.signal(signal.SIGKILL)
        await process.process.wait()
    begin = time.perf_counter()
    transport = await join_zenoh()
    assert time.perf_counter() - begin < 1.0
    left = {path.name for path in (place / "robotree" / "test").iterdir()}
    assert len(left) == 4, left  # the door, and the newcomer's entry, socket and Zenoh's lock on it
    await transport.close()
    assert [path.name for path in (place / "robotree" / "test").iterdir()] == [".door"]


@pytest.mark.parametrize("times", range(3))
async def test_a_process_that_forgets_to_close_still_ends(
    times: int, start: Start, join_zenoh: Enter
) -> None:
    transport = await join_zenoh()
    await transport.subscribe("robot/**", lambda _key, _body: None)
    process = await start("leave-open", f"r{times}")
    await process.ready()
    assert await process.end() == (0, "")


async def test_who_is_cancelled_while_it_declares_leaves_nothing_declared(join_zenoh: Enter) -> None:
    transport, key = await join_zenoh(), "robot/arm/1"

    async def handle(_body: bytes, respond: Respond) -> None:
        respond(b"served")

    for declaring in (transport.serve(key, handle), transport.announce(key)):
        task = asyncio.ensure_future(declaring)
        await asyncio.sleep(0)  # it has begun, and a thread goes on with it
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
    assert await transport.silent("robot/**") == [], "nobody is taken for one that hangs"
    assert await transport.present("robot/**") == []
    await transport.serve(key, handle)
    assert await replies_of(transport.request(key, b"", timeout=5)) == ([b"served"], None)


async def test_who_is_cancelled_twice_while_it_declares_leaves_nothing_declared(
    join_zenoh: Enter, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport, key, leave = await join_zenoh(), "robot/arm/1", threading.Event()
    session, loop = transport.session, asyncio.get_running_loop()
    announce, take_back = session.announce, session.take_back
    begun, over = loop.create_future(), loop.create_future()

    def slow(key: str) -> zenoh.LivelinessToken:
        loop.call_soon_threadsafe(begun.set_result, None)
        leave.wait()
        return announce(key)

    def told(key: str, token: zenoh.LivelinessToken) -> None:
        take_back(key, token)
        loop.call_soon_threadsafe(over.set_result, None)

    monkeypatch.setattr(session, "announce", slow)
    monkeypatch.setattr(session, "take_back", told)
    await cancelled_twice(transport.announce(key), begun)
    leave.set()
    await asyncio.wait_for(over, 5)
    assert await transport.silent("robot/**") == [], "nobody is taken for one that hangs"
    assert await transport.present("robot/**") == []


async def test_who_is_cancelled_twice_while_it_enters_is_not_there(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, leave, sessions = asyncio.get_running_loop(), threading.Event(), list[Session]()
    begun, over = loop.create_future(), loop.create_future()
    enter, close = Session.open, Session.close

    def slow(session: Session) -> None:
        sessions.append(session)
        loop.call_soon_threadsafe(begun.set_result, None)
        leave.wait()
        enter(session)

    def told(session: Session) -> None:
        close(session)
        loop.call_soon_threadsafe(over.set_result, None)

    monkeypatch.setattr(Session, "open", slow)
    monkeypatch.setattr(Session, "close", told)
    await cancelled_twice(join("test", root=place / "robotree"), begun)
    leave.set()
    await asyncio.wait_for(over, 10)
    assert [session.zenoh for session in sessions] == [None]
    assert list((place / "robotree" / "test").glob("*.entry")) == []


async def test_an_interrupt_ends_a_process_without_a_word(start: Start, join_zenoh: Enter) -> None:
    transport = await join_zenoh()
    await transport.subscribe("robot/**", lambda _key, _body: None)
    process = await start("wait-for-interrupt", "arm")
    await process.ready()
    await arrived(transport, "arm")
    process.signal(signal.SIGINT)
    assert await process.end() == (130, "")
