"""The one presence table of a process: asked in any thread, watched in order, certain of who hangs."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.presence import LONGEST, Held, Presence
from robotree.vr.network.mesh import HANGS, LATE, RECENT, STEADY, Mesh
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.world.testing import in_virtual_time
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
