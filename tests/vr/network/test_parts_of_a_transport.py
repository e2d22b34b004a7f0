"""The parts that transports are made of: replies, patterns, and the inbox."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.errors import NoAnswer, TransportClosed, Unreachable
from robotree.vr.base.pattern import Handlers, Keys, matches
from robotree.vr.network.link import PIECE, AskFrame, PeerLink, Sample, Unpacker, pack
from robotree.vr.network.on_loop import LoopTurns, Replies, SampleInbox
from robotree.vr.world.promises import replies_of
from robotree.vr.world.testing import in_virtual_time


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
