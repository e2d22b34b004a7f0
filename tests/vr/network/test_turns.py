from __future__ import annotations

import asyncio
import threading
from functools import partial

import pytest

from robotree.vr.base.transport import Respond
from robotree.vr.network.on_loop import SHARE, LoopTurns, SampleInbox, answered


async def test_what_is_urgent_goes_first_and_all_in_their_order() -> None:
    done: list[str] = []
    turns = LoopTurns()

    def bring() -> None:
        for number in range(3):
            turns.put(partial(done.append, f"other {number}"))
        for number in range(2):
            turns.put(partial(done.append, f"urgent {number}"), urgent=True)

    thread = threading.Thread(target=bring)
    thread.start()
    thread.join()
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert done == ["urgent 0", "urgent 1", "other 0", "other 1", "other 2"]


async def test_a_flood_leaves_the_loop_its_turns_and_urgent_things_overtake_it() -> None:
    done: list[int] = []
    turns = LoopTurns()
    for number in range(10 * SHARE):
        turns.put(partial(done.append, number))
    await asyncio.sleep(0)
    assert 0 < len(done) <= SHARE
    turns.put(partial(done.append, -1), urgent=True)
    await asyncio.sleep(0)
    assert -1 in done[: 2 * SHARE]
    for _ in range(11):
        await asyncio.sleep(0)
    done.remove(-1)
    assert done == list(range(10 * SHARE))


async def test_a_flood_of_samples_leaves_the_loop_its_turns_and_others_come_between() -> None:
    done: list[str] = []
    turns = LoopTurns()
    flooded, calm = (
        SampleInbox[int](turns, lambda n: done.append(f"flood {n}")),
        SampleInbox[str](turns, done.append),
    )
    for number in range(10 * SHARE):
        flooded.put(number)
    calm.put("sample")
    turns.put(partial(done.append, "request"))
    turns.put(partial(done.append, "renewal"), urgent=True)
    await asyncio.sleep(0)
    assert len(done) <= SHARE + 1
    assert done[0] == "renewal"
    assert max(done.index("sample"), done.index("request")) <= 4
    for _ in range(11):
        await asyncio.sleep(0)
    assert [one for one in done if "flood" in one] == [f"flood {number}" for number in range(10 * SHARE)]


async def test_one_that_raises_does_not_hold_up_the_others(caplog: pytest.LogCaptureFixture) -> None:
    done: list[int] = []
    turns = LoopTurns()
    turns.put(lambda: 1 / 0)
    turns.put(partial(done.append, 1))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert done == [1]
    assert "ZeroDivisionError" in caplog.text


def test_when_the_loop_is_closed_nothing_is_done_and_it_is_said() -> None:
    async def make() -> LoopTurns:
        return LoopTurns()

    turns = asyncio.run(make())
    assert not turns.put(lambda: None)
    assert not turns.put(lambda: None, urgent=True)


async def test_an_answer_that_takes_no_time_goes_out_with_the_end_of_the_replies() -> None:
    replies: list[object] = []
    done = asyncio.Event()

    def end(last: bytes | None) -> None:
        replies.append(("end", last))
        done.set()

    def at_once(body: bytes, respond: Respond) -> None:
        respond(b"first")
        respond(body)

    assert answered(at_once, b"last", replies.append, end, "key") is None
    assert replies == [b"first", ("end", b"last")]

    async def late(body: bytes, respond: Respond) -> None:
        respond(b"accepted")
        await asyncio.sleep(0)
        respond(body)

    replies.clear()
    done.clear()
    assert answered(late, b"late", replies.append, end, "key") is not None
    await done.wait()
    assert replies == [b"accepted", b"late", ("end", None)]


async def test_the_replies_end_also_when_a_handler_raises_or_is_cancelled_before_it_begins(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ends: list[bytes | None] = []

    def raises(_: bytes, respond: Respond) -> None:
        respond(b"so far")
        raise ValueError("a fault")

    assert answered(raises, b"", lambda _: None, ends.append, "key") is None
    assert ends == [b"so far"]
    assert "the handler of key raised" in caplog.text

    async def never(_: bytes, __: Respond) -> None:
        raise AssertionError("it was cancelled before")

    task = answered(never, b"", lambda _: None, ends.append, "key")
    assert task is not None
    task.cancel()
    await asyncio.wait([task])
    await asyncio.sleep(0)
    assert ends == [b"so far", None]
