"""Replies and effects come only after the journal has stored their cause."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.base.address import Address
from robotree.vr.base.errors import CommandCancelled, StaleEpoch
from robotree.vr.core import events as on
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import decode_state, encode_state
from robotree.vr.running.process import Process


class Book:
    """A journal that remembers how far it was committed."""

    def __init__(self) -> None:
        self.events: list[CoreEvent] = []
        self.committed = 0

    def append(self, _robot: str, _now: float, event: CoreEvent) -> None:
        self.events.append(event)

    def commit(self) -> None:
        self.committed = len(self.events)

    @property
    def is_whole(self) -> bool:
        return self.committed == len(self.events)


class Page(VirtualRobot):
    """Has room for a list."""

    @command
    def sort(self, numbers: list[float]) -> list[float]:
        numbers.append(9.0)
        return sorted(numbers)


class Patient(Robot):
    """Takes a second."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.begun = 0

    @command
    def wait(self) -> None:
        self.begun += 1
        self.sleep(1.0)


def kept(book: Book, agent: Any) -> list[tuple[str, bool]]:
    """From now on, what follows in a robot: its name, and whether all before it was committed."""
    found: list[tuple[str, bool]] = []

    def note(go_on: Callable[[Any], None], effect: Any) -> None:
        found.append((type(effect).__name__, book.is_whole))
        go_on(effect)

    agent.runtime._on_effect = partial(note, agent.runtime._on_effect)
    return found


async def test_accepted_is_said_when_the_call_is_committed(realm: Any) -> None:
    book = Book()
    page = await realm.start(Page("page"), process=Process(realm.runner, book))
    said: list[bool] = []
    post = page.runtime.post

    def look(event: CoreEvent, *, accepted: Callable[[], None] | None = None, **rest: Any) -> None:
        def accept() -> None:
            said.append(book.is_whole)
            if accepted is not None:
                accepted()

        post(event, accepted=accept, **rest)

    page.runtime.post = look
    assert await realm.client(page).call("sort", {"numbers": [2.0, 1.0]}) == [1.0, 2.0, 9.0]
    assert said
    assert all(said)


async def test_a_refused_event_that_let_time_pass_commits_what_the_time_has_changed(realm: Any) -> None:
    book = Book()
    process = Process(realm.runner, book)
    page = await realm.start(Page("page"), process=process)
    boss = Address("robot", "boss", "1")
    process.at = lambda *_: lambda: None  # the watchdog comes too late
    page.runtime.post(
        on.ParentAsked(parent=boss, slot="hand", lineage=("boss",), term=1.0, unix=realm.unix, key="k")
    )
    follows = kept(book, page)
    await realm.until(lambda: page.runtime.core.due < realm.runner.now())
    with pytest.raises(StaleEpoch):
        page.runtime.post(on.Prolong(parent=boss, epoch=1, lineage=("boss",)))
    assert follows == [("LeaseEnded", True)]


async def test_a_reload_is_committed_before_anybody_hears_of_it(realm: Any) -> None:
    book = Book()
    page = await realm.start(Page("page"), process=Process(realm.runner, book))
    heard: list[bool] = []
    page.runtime.reload(Page("page"), lambda _: heard.append(book.is_whole))
    assert heard == [True]
    assert isinstance(book.events[-1], on.PageReloaded)


async def test_code_that_changes_its_arguments_changes_nothing_of_the_state(realm: Any) -> None:
    seen: list[bool] = []

    class Curious(Page):
        @command
        def sort(self, numbers: list[float]) -> list[float]:
            before = encode_state(page.runtime.core.state)
            numbers.append(9.0)
            seen.append(encode_state(page.runtime.core.state) == before)
            return numbers

    page = await realm.start(Curious("page"))
    assert await realm.client(page).call("sort", {"numbers": [1.0]}) == [1.0, 9.0]
    assert seen == [True]


class Napper(VirtualRobot):
    """Sleeps."""

    @command
    def nap(self) -> None:
        self.sleep(0.5)


async def test_an_interruption_that_is_written_down_when_its_call_has_ended_leaves_nothing(
    realm: Any,
) -> None:
    class SlowForCancels(Book):
        def commit(self) -> None:
            if isinstance(self.events[-1], on.CancelAsked):
                realm.runner.waiter().wait(1.0)
            super().commit()

    page = await realm.start(Napper("page"), process=Process(realm.runner, SlowForCancels()))
    napping = asyncio.ensure_future(realm.client(page).call("nap", {}))
    await realm.until(lambda: page.runtime.runs)
    (key,) = page.runtime.runs
    cancelled: list[bool] = []

    def cancel() -> None:
        page.runtime.cancel(key, "it is late")
        cancelled.append(True)

    realm.runner.spawn(cancel, "who cancels")
    await napping
    await realm.until(lambda: cancelled)
    assert page.runtime.runs == {}


# -- a wait for somebody else ----------------------------------------------------------------------


class Arm(Robot):
    """An arm."""

    @command
    def go(self) -> None: ...


class Mover(VirtualRobot):
    """Has no arm, so that the description of its command is not known."""

    arm = Child("Arm")
    go = arm.exposed()


class Shop(VirtualRobot):
    """Lets the command through once more."""

    mover = Child("Mover")
    go = mover.exposed()


class Boss(VirtualRobot):
    """Calls it."""

    shop = Child("Shop")

    @command
    def work(self) -> None:
        self.shop.go()


async def test_a_cancel_ends_the_wait_for_a_description_at_once(realm: Any) -> None:
    mover = await realm.start(Mover("mover"), process=Process(realm.runner))
    realm.shared = Process(realm.runner)
    boss, shop = await realm.start(Boss("boss")), await realm.start(Shop("shop"))
    await realm.client(shop).enslave("mover", mover.address)
    await realm.client(boss).enslave("shop", shop.address)
    realm.network.pause(mover.transport)
    key = "k" * 18
    work = asyncio.ensure_future(realm.client(boss).call("work", {}, key=key))
    await realm.until(lambda: key in boss.runtime.runs and boss.runtime.runs[key].interrupt is not None)
    asked = realm.runner.now()
    await realm.client(boss).cancel(key)
    with pytest.raises(CommandCancelled):
        await work
    assert realm.runner.now() - asked < 0.1
    realm.network.resume(mover.transport)


async def restored(realm: Any) -> Any:
    before = await realm.start(Patient("patient"))
    kept_state = decode_state(encode_state(before.runtime.core.state))
    realm.kill(before)
    return await realm.start(Patient("patient"), state=kept_state)


async def test_a_command_that_comes_before_a_restored_robot_goes_on_waits_for_that(realm: Any) -> None:
    """The other robots of its host are not all back yet."""
    after = await restored(realm)
    call = asyncio.ensure_future(realm.client(after).call("wait", {}))
    await realm.until(lambda: bool(after._outside._waiting))
    assert after.robot.begun == 0
    after.go_on()
    await call
    assert after.robot.begun == 1


async def test_a_command_that_begins_before_a_restored_robot_goes_on_is_carried_out_once(realm: Any) -> None:
    """As one that a robot beside it calls, which went on before."""
    after = await restored(realm)
    after._outside.go_on()
    call = asyncio.ensure_future(realm.client(after).call("wait", {}))
    await realm.until(lambda: after.robot.begun > 0)
    after.go_on()
    await call
    assert after.robot.begun == 1


async def test_each_life_of_a_host_numbers_calls_under_a_name_of_its_own(realm: Any) -> None:
    """A child that remembers numbers of the life before must not take these for them."""
    lives = [Process(realm.runner), Process(realm.runner)]
    lives[1].life = 2
    names = [
        (await realm.start(Patient(f"p{n}"), process=life)).runtime._life for n, life in enumerate(lives)
    ]
    assert names[0] != names[1]
