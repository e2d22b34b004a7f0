"""All transports pass one examination, and so do their parts: replies, patterns, turns and inboxes."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.errors import NoAnswer, TransportClosed, Unreachable
from robotree.vr.base.pattern import Handlers, Keys, matches
from robotree.vr.base.presence import PresenceHandler, Undo
from robotree.vr.base.transport import Registration, Respond, Transport
from robotree.vr.network.link import PIECE, AskFrame, PeerLink, Sample, Unpacker, pack
from robotree.vr.network.on_loop import SHARE, LoopTurns, Replies, SampleInbox, answered
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.promises import replies_of
from robotree.vr.world.testing import TRANSPORT_CHECKS, Join, check_transport, in_virtual_time

Check = Callable[[Join], Awaitable[None]]


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
@in_virtual_time
async def test_memory(check: Check, join_memory: Join) -> None:
    await check(join_memory)


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_local(check: Check, join_realm: Join) -> None:
    await check(join_realm)


@pytest.mark.parametrize("delay", [0.0, 0.003])
@in_virtual_time
async def test_a_whole_network_can_be_examined_at_once(delay: float) -> None:
    network = MemoryNetwork(delay=delay)
    network.weather.jitter = delay

    async def join() -> Transport:
        return network.join()

    await check_transport(join)


async def test_a_memory_network_runs_in_real_time_too(join_memory: Join) -> None:
    for check in TRANSPORT_CHECKS[:4]:
        await check(join_memory)


class Mute(MemoryTransport):
    """Loses what is published."""

    def publish(self, key: str, body: bytes) -> None:
        if key == "probe":
            super().publish(key, body)


class Stubborn(MemoryTransport):
    """Goes on after it was closed."""

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        self.closed = False
        return await super().announce(key, unless=unless)


class Blind(MemoryTransport):
    """Does not tell what was there before."""

    def __init__(self, network: MemoryNetwork, name: str) -> None:
        super().__init__(network, name)
        watch = self.presence.watch

        def blind(pattern: str, handler: PresenceHandler) -> Undo:
            there = self.presence.keys(pattern)
            return watch(pattern, lambda key, now: None if key in there else handler(key, now))

        self.presence.watch = blind  # type: ignore[method-assign]


@pytest.mark.parametrize("broken", [Mute, Stubborn, Blind])
@in_virtual_time
async def test_the_examination_notices_a_broken_promise(broken: type[MemoryTransport]) -> None:
    network = MemoryNetwork()

    async def join() -> Transport:
        return network.enter(broken(network, "broken"))

    with pytest.raises(AssertionError, match="broken:"):
        await check_transport(join)


# -- the parts: replies, patterns, and the inbox ---------------------------------------------------


@in_virtual_time
async def test_replies_end_as_they_were_ended() -> None:
    for end, error in (
        (Replies.end, Unreachable),
        (Replies.time_out, NoAnswer),
        (Replies.shut, TransportClosed),
    ):
        nothing, something = Replies("key", 5), Replies("key", 5)
        something.feed(b"1")
        for replies in (nothing, something):
            end(replies)
            replies.feed(b"too late")
            replies.end()
        assert isinstance((await replies_of(nothing))[1], error)
        bodies, ended = await replies_of(something)
        assert bodies == [b"1"]
        assert ended is None if error is Unreachable else isinstance(ended, error)
        assert await replies_of(something) == ([], None), "an end is told once"


@in_virtual_time
async def test_the_time_for_replies_runs_from_the_question_on() -> None:
    loop = asyncio.get_running_loop()
    replies = Replies("key", 1.0)
    for at in (0.4, 0.8, 1.2):
        loop.call_later(at, replies.feed, b"%.1f" % at)
    bodies, error = await replies_of(replies)
    assert (bodies, loop.time()) == ([b"0.4", b"0.8"], pytest.approx(1.0))
    assert str(error) == "key did not answer within 1 s; it hangs or the network is cut"


@pytest.mark.parametrize(
    ("pattern", "key", "expected"),
    [
        ("robot/*/*", "robot/a/1", True),
        ("robot/*/*", "robot/a/1/state", False),
        ("robot/*/*", "robot/a", False),
        ("robot/**", "robot", True),
        ("robot/**", "robots/a", False),
        ("robot/**/state", "robot/a/1/state", True),
        ("**", "a", True),
        ("*", "a/b", False),
        ("**/*", "a/b/c", True),
    ],
)
def test_a_star_is_one_chunk_and_two_are_any_number(pattern: str, key: str, *, expected: bool) -> None:
    assert matches(pattern, key) == expected


chunks = st.lists(st.text("ab.+(", min_size=1, max_size=3), min_size=1, max_size=4)


@given(key=chunks, other=chunks)
def test_a_pattern_without_stars_is_a_key(key: list[str], other: list[str]) -> None:
    assert matches("/".join(key), "/".join(other)) == (key == other)
    assert matches("/".join("*" * len(key)), "/".join(key))
    assert matches("**", "/".join(key))


few = st.lists(st.sampled_from(["a", "b"]), min_size=1, max_size=4).map("/".join)
patterns = st.lists(st.sampled_from(["a", "b", "*", "**"]), min_size=1, max_size=4).map("/".join)


@given(added=st.lists(few), removed=st.lists(few), pattern=patterns)
def test_a_search_in_groups_finds_what_a_look_at_every_key_finds(
    added: list[str], removed: list[str], pattern: str
) -> None:
    keys, left = Keys(), Counter[str]()
    for key in added:
        assert keys.add(key) == (left[key] == 0)
        left[key] += 1
    for key in removed:
        assert keys.remove(key) == (left[key] == 1)
        left[key] -= left[key] > 0
    assert keys.under(pattern) == sorted(key for key in +left if matches(pattern, key))
    assert set(keys) == set(+left)


@given(asked=st.lists(patterns, max_size=5), key=few, gone=st.integers(0, 4))
def test_a_key_has_the_handlers_of_all_patterns_above_it(asked: list[str], key: str, gone: int) -> None:
    handlers = Handlers[int]()
    for number, pattern in enumerate(asked):
        handlers.add(number, pattern, number)
    assert handlers.remove(gone) == (asked[gone] if gone < len(asked) else None)
    assert handlers.remove(gone) is None
    assert sorted(handlers.of(key)) == [
        number for number, pattern in enumerate(asked) if number != gone and matches(pattern, key)
    ]


@in_virtual_time
async def test_an_inbox_keeps_order_loses_the_oldest_and_survives_its_reader(
    caplog: pytest.LogCaptureFixture,
) -> None:
    taken: list[int] = []

    def take(item: int) -> None:
        taken.append(item)
        if item == 7:
            raise RuntimeError("on purpose")

    inbox = SampleInbox(LoopTurns(), take, limit=4)
    thread = threading.Thread(target=lambda: [inbox.put(number) for number in range(10)])
    thread.start()
    thread.join()
    await asyncio.sleep(0.1)
    assert taken == [6, 7, 8, 9]
    assert "on purpose" in caplog.text
    inbox.close()
    inbox.put(11)
    await asyncio.sleep(0.1)
    assert len(taken) == 4


def test_an_inbox_may_outlive_its_loop() -> None:
    taken: list[int] = []

    async def make() -> SampleInbox[int]:
        return SampleInbox(LoopTurns(), taken.append)

    inbox = asyncio.run(make())
    inbox.put(1)
    assert taken == []


def test_a_receiver_that_does_not_read_misses_older_samples_and_never_the_newest_of_a_key() -> None:
    near, far = socket.socketpair()
    link, unpacker = PeerLink(near, wants_to_write=lambda _: None), Unpacker()
    link.send(pack(AskFrame(0, "large", bytes(3_000_000))))  # and this thread goes on
    for number in range(1000):
        for key in ("a", "b"):
            link.publish(key, pack(Sample(key, b"%d " % number + bytes(4000))))
    heard: dict[str, list[int]] = {"a": [], "b": []}
    waits = True
    while waits:
        waits = link.flush()
        with contextlib.suppress(BlockingIOError):
            while True:
                for frame in unpacker.feed(far.recv(PIECE, socket.MSG_DONTWAIT)):
                    if isinstance(frame, Sample):
                        heard[frame.key].append(int(frame.body.split()[0]))
    link.close()
    far.close()
    for numbers in heard.values():
        assert numbers[-1] == 999
        assert numbers == sorted(set(numbers)), "in their order, each once"
        assert len(numbers) < 400, "more do not wait"


# -- turns of an event loop ------------------------------------------------------------------------


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
