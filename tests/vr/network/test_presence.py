"""Who is there, as a process knows it: in its table, in the record of the folder, and to the end of each."""

from __future__ import annotations

import asyncio
import math
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, combinations
from pathlib import Path

import pytest

from robotree import files
from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.os_files import OSFiles
from robotree.vr.base.presence import LONGEST, Held, Presence
from robotree.vr.network import rendezvous
from robotree.vr.network.link import Channel, News, Sample, Topic
from robotree.vr.network.mesh import HANGS, LATE, RECENT, STEADY, Mesh
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.world.testing import in_virtual_time
from tests.vr.network.visitor import SOON, Visitor, descriptors
from tests.waiting import wait_until

ARM = "robot/arm/1"
HELD = Held(ARM, "process 4711", "wake it")


class Table(Presence):
    """A table whose network the test plays; what is handed on waits in `on_the_way`."""

    def __init__(self) -> None:
        self.on_the_way: list[Callable[[], object]] = []
        self.doubts: list[tuple[Held, bool]] = []
        super().__init__(held=lambda _: [], unheard=lambda _: self.doubts, hand_on=self.on_the_way.append)

    def deliver(self) -> None:
        while self.on_the_way:
            self.on_the_way.pop(0)()


def test_an_answer_is_ahead_of_the_news_that_are_on_their_way() -> None:
    table, told = Table(), list[tuple[str, bool]]()
    table.watch("robot/*/*", lambda key, there: told.append((key, there)))
    table.count(ARM, there=True)
    assert (table.there(ARM), table.keys("robot/**"), told) == (True, [ARM], [])
    table.deliver()
    assert told == [(ARM, True)]


def test_who_begins_to_watch_is_told_each_change_once() -> None:
    """Also when news of what it is told first are on their way to others."""
    table, early, late = Table(), list[bool](), list[bool]()
    table.watch(ARM, lambda _, there: early.append(there))
    table.count(ARM, there=True)
    table.watch("**", lambda _, there: late.append(there))
    table.count(ARM, there=True)  # by a second process
    table.count(ARM, there=False)
    table.count(ARM, there=False)
    table.deliver()
    assert (early, late) == ([True, False], [True, False])


@pytest.mark.parametrize("end", ["undo", "close"])
def test_news_that_are_on_their_way_do_not_reach_a_watch_that_has_ended(end: str) -> None:
    table, told = Table(), list[bool]()
    undo = table.watch(ARM, lambda _, there: told.append(there))
    table.count(ARM, there=True)
    (undo if end == "undo" else table.close)()
    undo()
    table.deliver()
    assert told == []


def test_a_table_that_many_threads_fill_and_ask_loses_nothing() -> None:
    table, seen = Table(), set[str]()
    names = [f"robot/r{number}/1" for number in range(200)]

    def come(mine: list[str]) -> None:
        for key in mine:
            table.count(key, there=True)
            assert key in table.keys("robot/*/*")

    threads = [threading.Thread(target=come, args=(names[part::4],)) for part in range(4)]
    for thread in threads:
        thread.start()
    table.watch("robot/*/*", lambda key, _: seen.add(key))
    for thread in threads:
        thread.join()
    table.deliver()
    assert (sorted(seen), table.keys("**")) == (sorted(names), sorted(names))


@in_virtual_time
async def test_one_waits_for_a_presence_or_its_end_as_long_as_one_will() -> None:
    table, loop = Table(), asyncio.get_running_loop()
    table.hand_on = loop.call_soon
    loop.call_later(1.0, lambda: table.count(ARM, there=True))
    loop.call_later(3.0, lambda: table.count(ARM, there=False))
    assert not await table.until(ARM, there=True, within=0.5)
    assert await table.until("robot/arm/*", there=True, within=5.0)
    assert loop.time() == pytest.approx(1.0)
    assert await table.until("robot/arm/*", there=False, within=5.0)
    assert loop.time() == pytest.approx(3.0)
    assert await table.until(ARM, there=False, within=0.0), "it is so already"


@pytest.mark.parametrize(("judged_after", "hangs"), [(0.4, True), (0.4, False), (2 * LONGEST, True)])
@in_virtual_time
async def test_nobody_is_said_to_hang_before_that_is_certain(judged_after: float, *, hangs: bool) -> None:
    table, loop = Table(), asyncio.get_running_loop()
    other = Held("robot/other/1", "process 12", "")
    table.doubts = [(HELD, False), (other, True)]
    certain = [(HELD, True)] if hangs else []
    loop.call_later(judged_after, lambda: setattr(table, "doubts", [*certain, (other, True)]))
    found = await table.hanging("**")
    assert found == ([HELD, other] if hangs else [other])
    assert loop.time() == pytest.approx(min(judged_after, LONGEST), abs=0.06)


@in_virtual_time
async def test_of_many_that_are_slow_in_turns_none_is_said_to_hang() -> None:
    """On a busy machine one or another gives no sign of life at each look."""
    table, looks = Table(), 0
    slow = [Held(f"robot/r{number}/1", "process 1", "") for number in range(2)]

    def unheard(_: str) -> list[tuple[Held, bool]]:
        nonlocal looks
        looks += 1
        return [(slow[looks % 2], False)]

    table._unheard = unheard
    assert await table.hanging("**") == []
    assert looks == 2


@in_virtual_time
async def test_a_closed_table_refuses_every_question() -> None:
    table = Table()
    table.close()
    for ask in (table.keys, table.held, lambda every: table.watch(every, lambda _key, _there: None)):
        with pytest.raises(TransportClosed):
            ask("**")
    with pytest.raises(TransportClosed):
        await table.hanging("**")


# -- between processes -----------------------------------------------------------------------------


@pytest.fixture
def there(tmp_path: Path) -> Iterator[Rendezvous]:
    """The place of a process that holds a robot and reads nothing of what it is sent."""
    place = Rendezvous("test", tmp_path / "r")
    with place.register():
        place.hold(ARM)
        yield place


@pytest.mark.parametrize(
    ("silent_for", "known_for", "hangs"),
    [
        (0.0, 0.0, False),
        (RECENT, 0.0, False),
        (0.0, HANGS + 0.1, True),
        (HANGS + 0.1, 0.0, True),
    ],
    ids=["it comes", "it is slow", "it beats and cannot be met", "its beat is old"],
)
def test_a_newcomer_doubts_one_that_it_has_not_met_until_that_must_hang(
    there: Rendezvous, tmp_path: Path, silent_for: float, known_for: float, *, hangs: bool
) -> None:
    newcomer = Mesh(Rendezvous("test", tmp_path / "r"))
    newcomer.open(greeting=0)
    there.beat(time.monotonic() - silent_for)
    (peer,) = newcomer._peers.values()
    peer.since -= known_for
    ((one, certain),) = newcomer.unheard("robot/*/*")
    assert (one.key, certain) == (ARM, hangs)
    assert f"`kill {os.getpid()}` ends it" in one.remedy, "it is not stopped"
    assert "kill -9" not in one.remedy, "it may answer others"
    assert newcomer.presence.lives(ARM)
    assert not newcomer.presence.there(ARM)
    newcomer.close().result(60.0)


@pytest.fixture
def three(tmp_path: Path) -> Iterator[list[Mesh]]:
    meshes = [Mesh(Rendezvous("test", tmp_path / "r")) for _ in range(3)]
    for mesh in meshes:
        mesh.open()
    yield meshes
    for mesh in meshes:
        mesh.close().result(60.0)


@pytest.mark.speed
def test_a_process_that_misses_its_beat_is_late_within_a_second_and_does_not_flicker(
    three: list[Mesh], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is shown before it is known to hang, nothing else follows, and one beat in time does not end it."""
    here, there, _ = three
    there.announce(ARM)
    wait_until(lambda: here.presence.there(ARM), "it is not so")
    assert here.presence.late("**") == []
    beat, last = there.place.beat, time.monotonic()
    monkeypatch.setattr(there.place, "beat", lambda _: None)
    wait_until(lambda: here.presence.late("robot/*/*") != [], "it is not so")
    assert LATE - 0.05 < time.monotonic() - last < HANGS
    assert here.presence.there(ARM), "it counts as present"
    assert here.presence.hangs("**") == [], "and not as one that hangs"
    monkeypatch.setattr(there.place, "beat", beat)
    beat(again := time.monotonic())
    shown = [here.presence.late("**") != []]
    while time.monotonic() - again < STEADY + 0.5:
        time.sleep(0.02)
        late = here.presence.late("**") != []
        if late != shown[-1]:
            shown.append(late)
    assert shown == [True, False], "it is late once, and then no longer"


def test_who_says_so_has_left_and_who_dies_has_not(three: list[Mesh]) -> None:
    here, polite, lost = three
    polite.announce("robot/polite/1")
    lost.announce("robot/lost/1")
    wait_until(lambda: len(here.presence.keys("robot/*/*")) == 2, "it is not so")
    polite.withdraw("robot/polite/1")
    for mesh in (polite, lost):
        mesh.close().result(60.0)
    wait_until(lambda: here.presence.keys("robot/*/*") == [], "it is not so")
    assert here.presence.left("robot/polite/1"), "though its process has ended since"
    assert not here.presence.left("robot/lost/1")


# -- the record is complete, whatever happens to the folder while it is read -----------------------

Change = Callable[["Frozen"], None]


class Frozen:
    """A process that holds a robot and answers nobody; its socket accepts what the kernel accepts."""

    def __init__(self, root: Path) -> None:
        self.place = Rendezvous("test", root)
        self.doors = [self.place.register()]
        self.place.hold(ARM)

    def lose_its_folder(self) -> None:
        shutil.rmtree(self.place.directory, ignore_errors=True)

    def lose_its_list(self) -> None:
        (self.place.directory / f"{self.place.tag}.held").unlink(missing_ok=True)

    def lose_its_name(self) -> None:
        (self.place.directory / f"{self.place.tag}.sock").unlink(missing_ok=True)

    def come_again(self) -> None:
        self.doors.append(self.place.register())
        self.doors.pop(0).close()

    def close(self) -> None:
        for door in self.doors:
            door.close()


@pytest.fixture
def frozen(tmp_path: Path) -> Iterator[Frozen]:
    process = Frozen(tmp_path / "r")
    yield process
    process.close()


class Steps:
    """Counts the steps in which the record is read, and changes something before one of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done, self.at, self.change = 0, -1, lambda: None
        for owner, name in (
            (rendezvous, "listening"),
            (os, "scandir"),
            (files, "read"),
            (OSFiles, "lives"),
        ):
            monkeypatch.setattr(owner, name, self._counted(getattr(owner, name)))

    def _counted(self, step: Callable[..., object]) -> Callable[..., object]:
        def counted(*args: object, **options: object) -> object:
            self.done += 1
            if self.done == self.at:
                self.at = -1  # the change is made once
                self.change()
            return step(*args, **options)

        return counted


def lose_and_come(frozen: Frozen) -> None:
    frozen.lose_its_folder()
    frozen.come_again()


@pytest.mark.parametrize("met_before", [False, True])
@pytest.mark.parametrize(
    ("before", "change"),
    [
        (None, Frozen.lose_its_folder),
        (None, Frozen.lose_its_list),
        (None, Frozen.lose_its_name),
        (None, lose_and_come),
        (Frozen.lose_its_folder, Frozen.come_again),
        (Frozen.lose_its_list, Frozen.lose_its_name),
        (Frozen.lose_its_name, Frozen.come_again),
    ],
)
def test_a_change_of_the_folder_at_any_step_hides_no_process(
    *,
    before: Change | None,
    change: Change,
    met_before: bool,
    frozen: Frozen,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    newcomer = Mesh(Rendezvous("test", frozen.place.directory.parent))
    if met_before:
        newcomer._dial_all()  # it does not answer the greeting
        assert frozen.place.tag in newcomer._peers
    steps = Steps(monkeypatch)
    newcomer.held("robot/*/*")
    most = steps.done
    assert most > 2
    for step in range(1, most + 2):
        frozen.come_again()
        if before is not None:
            before(frozen)
        steps.done, steps.at, steps.change = 0, step, lambda: change(frozen)
        found = newcomer.held("robot/*/*")
        assert [one for one in found if one.key in {ARM, ""}], f"missed at step {step} of {most}"
    newcomer.close()


@pytest.mark.parametrize("channel", list(Channel))
def test_a_stop_is_left_for_a_process_of_which_one_channel_is_known(frozen: Frozen, channel: Channel) -> None:
    """A newcomer may have said hello on either channel first; only what is urgent comes in order."""
    newcomer = Mesh(Rendezvous("test", frozen.place.directory.parent))
    newcomer._dial_all()
    links = newcomer._peers[frozen.place.tag].links
    links.pop(channel).close()
    replies: list[bytes | None] = []
    newcomer.ask(ARM, b"halt", void_at=math.inf, urgent=True, on_reply=replies.append)
    assert replies == [None], "nobody waits for it"
    heard = b""
    for _ in Channel:
        with frozen.doors[0].accept()[0] as line:
            heard += line.recv(65536)
    assert (b"halt" in heard) == (channel is not Channel.URGENT)
    newcomer.close()


# -- the end of a process is seen, whatever it said last and however late that is read -------------

LAST_WORDS = {
    Channel.URGENT: News(Topic.HOLDS, "robot/arm/2", there=True),
    Channel.BULK: Sample("robot/arm/1/state", b"last words"),
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

    def sees(self, key: str = ARM) -> bool:
        return self.mesh.presence.there(key)


@pytest.fixture
def held_up(tmp_path: Path) -> Iterator[HeldUp]:
    one = HeldUp(tmp_path / "r")
    yield one
    one.go.set()
    one.mesh.close().result(SOON)


def visit(held_up: HeldUp) -> Visitor:
    visitor = Visitor(held_up.mesh.place, held_up.mesh.place.tag)
    visitor.greet(ARM)
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
