"""The end of a process is seen, whatever it said last and however late that is read."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from pathlib import Path

import pytest

from robotree.vr.network.link import Channel, News, Sample, Topic
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.rendezvous import Rendezvous
from tests.vr.network.visitor import SOON, Visitor, descriptors
from tests.waiting import wait_until

KEY = "robot/arm-1/1"
LAST_WORDS = {
    Channel.URGENT: News(Topic.HOLDS, "robot/arm-1/2", there=True),
    Channel.BULK: Sample("robot/arm-1/1/state", b"last words"),
}
ALL = [*chain.from_iterable(combinations(Channel, count) for count in range(len(Channel) + 1))]


class HeldUp:
    """A mesh whose reader can be held up in a callback, as a machine under load holds up a thread."""

    def __init__(self, root: Path) -> None:
        self.mesh = Mesh(Rendezvous("test", root))
        self.mesh.open()
        self.held_up, self.go = threading.Event(), threading.Event()
        self.mesh.subscribe("hold/up", lambda _key, _body: (self.held_up.set(), self.go.wait(SOON)))

    def hold_up(self, visitor: Visitor) -> None:
        visitor.say(Channel.BULK, Sample("hold/up", b""))
        assert self.held_up.wait(SOON)

    def sees(self, key: str = KEY) -> bool:
        return self.mesh.presence.there(key)


@pytest.fixture
def held_up(tmp_path: Path) -> Iterator[HeldUp]:
    one = HeldUp(tmp_path / "r")
    yield one
    one.go.set()
    one.mesh.close().result(SOON)


def visit(held_up: HeldUp) -> Visitor:
    visitor = Visitor(held_up.mesh.place, held_up.mesh.place.tag)
    visitor.greet(KEY)
    wait_until(held_up.sees, "it is seen")
    return visitor


@pytest.mark.parametrize(
    "channels", ALL, ids=lambda channels: "+".join(one.name for one in channels) or "none"
)
def test_the_end_of_a_process_is_seen_though_it_comes_together_with_data(
    held_up: HeldUp, channels: Sequence[Channel]
) -> None:
    before = descriptors()
    visitor = visit(held_up)
    held_up.hold_up(visitor)
    for channel in channels:
        visitor.say(channel, LAST_WORDS[channel])
    visitor.close()
    held_up.go.set()
    wait_until(lambda: not held_up.sees(), "its end is not seen")
    wait_until(lambda: descriptors() == before, "its connections are kept")


@pytest.mark.parametrize("channel", Channel, ids=lambda channel: channel.name)
def test_one_of_two_connections_that_breaks_with_data_ends_both(held_up: HeldUp, channel: Channel) -> None:
    before = descriptors()
    visitor = visit(held_up)
    held_up.hold_up(visitor)
    visitor.say(channel, LAST_WORDS[channel])
    visitor.lines.pop(channel).close()
    held_up.go.set()
    wait_until(lambda: not held_up.sees(), "its end is not seen")
    wait_until(lambda: descriptors() == before + len(visitor.lines), "its connections are kept")
    visitor.close()


def test_a_connection_that_is_closed_in_one_direction_only_has_ended(held_up: HeldUp) -> None:
    visitor = visit(held_up)
    held_up.hold_up(visitor)
    visitor.say(Channel.URGENT, LAST_WORDS[Channel.URGENT])
    visitor.lines[Channel.URGENT].shutdown(1)
    held_up.go.set()
    assert visitor.is_cut_off(Channel.BULK), "its end is not seen"
    visitor.close()


def test_who_dials_says_half_a_word_and_dies_leaves_nothing_behind(held_up: HeldUp) -> None:
    before = descriptors()
    visitor = visit(held_up)
    held_up.hold_up(visitor)
    half = Visitor(held_up.mesh.place, held_up.mesh.place.tag)
    half.dial(Channel.URGENT).sendall(b"\x40\x00\x00\x00half a hello")
    half.close()
    visitor.close()
    held_up.go.set()
    wait_until(lambda: not held_up.sees(), "its end is not seen")
    wait_until(lambda: descriptors() == before, "the connection of the half word is kept")
