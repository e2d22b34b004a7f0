"""What the author of a page expects of `self.space`."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest

from robotree.vr import VirtualRobot, VrError, command
from robotree.vr.base.errors import (
    BadEntry,
    CommandFailed,
    EntryUnfit,
    FenceLost,
    KeyTaken,
    NoSpace,
    NoSuchEntry,
    SeveralSpaces,
    SpaceLost,
    TransactionOver,
)
from robotree.vr.space.service import SpaceService
from robotree.vr.space.store import MemoryStore

pytestmark = pytest.mark.usefixtures("space")


@dataclass(frozen=True)
class Task:
    """Something to do."""

    place: str | None = None


@dataclass(frozen=True)
class Delivery(Task):
    """A task of a kind."""

    weight: float = 0.0


class Report(msgspec.Struct, frozen=True):
    """That something was done."""

    text: str


@dataclass(frozen=True)
class Heavy:
    """Another program's `Delivery`: see `test_an_entry_of_another_version_stays`."""

    weight: str


class Worker(VirtualRobot):
    """Works with the space."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.results: list[Any] = []

    @command
    def put(self, place: str, weight: float = 0.0, lease: float = 0.0, key: str = "") -> int:
        """Write a delivery."""
        return self.space.write(Delivery(place, weight), lease=lease or None, key=key).id

    @command
    def fetch(self, place: str = "", within: float = 0.0) -> str:
        """Take a task."""
        fields = {"place": place} if place else {}
        task = self.space.take(Task, within=within, **fields)
        return "none" if task is None else f"{type(task).__name__} {task.place}"

    @command
    def look(self) -> list[str]:
        """Read all tasks."""
        return [f"{type(task).__name__} {task.place}" for task in self.space.read_all(Task)]

    @command
    def exchange(self, seconds: float = 0.0, *, fail: bool = False) -> str:
        """Take a task and report it, as one."""
        with self.space.transaction(within=10) as tx:
            task = tx.take(Task)
            tx.write(Report(f"did {task and task.place}"))
            self.sleep(seconds)
            if fail:
                raise RuntimeError("a mistake of the page")
        return "done"

    @command
    def report(self) -> str:
        """Take a report."""
        report = self.space.take(Report)
        return "none" if report is None else report.text

    @command
    def listen(self, times: int) -> int:
        """Count the hints."""
        heard = 0
        for _ in self.space.notify(Delivery, place="hall", within=30):
            heard += 1
            if heard == times:
                break
        return heard

    @command
    def hold(self, seconds: float, ttl: float = 5.0, within: float = 0.0) -> int:
        """Hold a fence."""
        with self.space.acquire("door", ttl=ttl, within=within) as fence:
            self.sleep(seconds)
            return fence.epoch

    @command
    def try_it(self, what: str) -> str:  # noqa: C901 # one case for each mistake
        """Provoke an error; returns its class."""
        space = self.space
        try:
            match what:
                case "no entry":
                    space.write({"place": "hall"})
                case "no such field":
                    space.take(Task, colour="red")
                case "no class":
                    space.take(dict)
                case "renew a taken one":
                    lease = space.write(Task("x"), lease=5)
                    space.take(Task, place="x")
                    lease.renew(5)
                case "cancel":
                    lease = space.write(Task("x"), lease="5 s")
                    lease.renew("10 s")
                    lease.cancel()
                    assert space.read(Task, place="x") is None
                    lease.cancel()
                case "key":
                    space.write(Task("x"), key="k")
                    space.write(Task("y"), key="k")
                case "fence":
                    with space.acquire("door", ttl=1) as fence:
                        self.sleep(2)
                        fence.renew()
                case "instance":
                    space.write(Delivery("hall", 2))
                    found = space.take(Delivery(None, 2))
                    return repr(found)
                case "unfit":
                    space.write(_renamed(Heavy("a lot")))
                    space.take(Delivery)
                case "zero":
                    space.write(Task("x"), lease=-1)
                case _:
                    raise AssertionError(what)
        except (VrError, ValueError) as error:
            return f"{type(error).__name__}: {error}"
        return "no error"


def _renamed(record: Any) -> Any:
    """Return a record whose class is called `Delivery`, too, as another program's may be."""
    cls = type("Delivery", (type(record),), {"__module__": __name__})
    return dataclass(frozen=True)(cls)(record.weight)


@pytest.fixture
async def space(realm: Any) -> AsyncIterator[SpaceService]:
    async with asyncio.timeout(60):
        service = await start(realm, "jobs")
    yield service
    await service.close()


@pytest.fixture
async def one(realm: Any) -> Any:
    return await realm.start(Worker("one"))


@pytest.fixture
async def other(realm: Any) -> Any:
    return await realm.start(Worker("other"))


async def start(realm: Any, name: str) -> SpaceService:
    loop = asyncio.get_running_loop()
    service = SpaceService(realm.network.join(name), name, MemoryStore(name, loop.time))
    await service.start()
    return service


async def call(realm: Any, agent: Any, name: str, **arguments: Any) -> Any:
    return await realm.client(agent).call(name, arguments)


async def test_what_a_robot_writes_another_one_takes(realm: Any, one: Any, other: Any) -> None:
    await call(realm, one, "put", place="hall", weight=2.5)
    await call(realm, one, "put", place="door")
    assert await call(realm, other, "look") == ["Delivery hall", "Delivery door"]
    assert await call(realm, other, "fetch", place="door") == "Delivery door"
    assert await call(realm, other, "fetch") == "Delivery hall"
    assert await call(realm, other, "fetch") == "none"


async def test_a_take_waits_for_an_entry(realm: Any, one: Any, other: Any) -> None:
    began = realm.runner.now()
    taking = asyncio.create_task(call(realm, other, "fetch", place="hall", within=20))
    await asyncio.sleep(3)
    await call(realm, one, "put", place="door")
    await call(realm, one, "put", place="hall")
    assert await taking == "Delivery hall"
    assert realm.runner.now() - began == pytest.approx(3, abs=0.5)
    assert await call(realm, other, "fetch", place="hall", within=5) == "none"
    assert realm.runner.now() - began == pytest.approx(8, abs=0.5)


async def test_a_cancel_ends_a_take_and_takes_nothing(realm: Any, one: Any, other: Any) -> None:
    taking = asyncio.create_task(call(realm, other, "fetch", within=50))
    await asyncio.sleep(1)
    await realm.client(other).cancel()
    with pytest.raises(VrError, match="cancelled"):
        await taking
    await call(realm, one, "put", place="hall")
    assert await call(realm, one, "look") == ["Delivery hall"]


async def test_a_robot_that_dies_while_it_waits_takes_nothing(realm: Any, one: Any, other: Any) -> None:
    taking = asyncio.create_task(call(realm, other, "fetch", within=50))
    await asyncio.sleep(1)
    realm.kill(other)
    with pytest.raises(VrError):
        await taking
    await call(realm, one, "put", place="hall")
    assert await call(realm, one, "look") == ["Delivery hall"]


async def test_a_transaction_is_all_or_nothing(realm: Any, one: Any, other: Any) -> None:
    await call(realm, one, "put", place="hall")
    with pytest.raises(CommandFailed, match="a mistake of the page"):
        await call(realm, other, "exchange", fail=True)
    assert await call(realm, one, "look") == ["Delivery hall"]
    assert await call(realm, one, "report") == "none"
    exchanging = asyncio.create_task(call(realm, other, "exchange", seconds=5))
    await asyncio.sleep(2)
    assert await call(realm, one, "look") == []
    assert await call(realm, one, "report") == "none"
    assert await exchanging == "done"
    assert await call(realm, one, "report") == "did hall"


async def test_a_transaction_that_lasts_too_long_has_done_nothing(realm: Any, one: Any) -> None:
    await call(realm, one, "put", place="hall")
    with pytest.raises(TransactionOver, match="all of it was taken back"):
        await call(realm, one, "exchange", seconds=11)
    assert await call(realm, one, "look") == ["Delivery hall"]


async def test_a_notification_is_a_hint(realm: Any, one: Any, other: Any) -> None:
    await call(realm, one, "put", place="hall")  # before: no hint
    listening = asyncio.create_task(call(realm, other, "listen", times=2))
    await asyncio.sleep(1)
    await call(realm, one, "put", place="door")
    await call(realm, one, "put", place="hall")
    await asyncio.sleep(1)
    assert not listening.done()
    await call(realm, one, "put", place="hall")
    assert await listening == 2
    assert await call(realm, other, "listen", times=1) == 0, "its time is over"


async def test_a_holder_that_dies_lets_go(realm: Any, one: Any, other: Any) -> None:
    holding = asyncio.create_task(call(realm, one, "hold", seconds=50, ttl=50))
    await asyncio.sleep(1)
    realm.kill(one)
    with pytest.raises(VrError):
        await holding
    assert await call(realm, other, "hold", seconds=0, within=5) == 2


@pytest.mark.parametrize(
    ("what", "error", "text"),
    [
        ("no entry", BadEntry, "dict cannot be an entry of a space"),
        ("no class", BadEntry, "only a dataclass"),
        ("no such field", BadEntry, "it has no field 'colour'; it has: place"),
        ("renew a taken one", NoSuchEntry, "it was taken or cancelled"),
        ("cancel", NoSuchEntry, "it was taken or cancelled"),
        ("key", KeyTaken, "the key 'k'"),
        ("fence", FenceLost, "epoch 1 of door is over"),
        ("zero", ValueError, "-1 is no time"),
    ],
)
async def test_an_error_says_whose_fault_it_is(
    realm: Any, what: str, error: type[Exception], text: str, one: Any
) -> None:
    answer = await call(realm, one, "try_it", what=what)
    assert answer.startswith(f"{error.__name__}: ")
    assert text in answer


async def test_an_entry_can_be_a_template(realm: Any, one: Any) -> None:
    assert await call(realm, one, "try_it", what="instance") == "Delivery(place='hall', weight=2.0)"


async def test_an_entry_of_another_version_stays(realm: Any, space: SpaceService, one: Any) -> None:
    answer = await call(realm, one, "try_it", what="unfit")
    assert answer.startswith(f"{EntryUnfit.__name__}: an entry of kind Delivery does not fit")
    assert "Expected `float`, got `str`" in answer
    assert [each.entry.kind for each in space._store.contents("", 9).entries] == ["Delivery"]


async def test_without_a_space_the_error_says_how_to_start_one(realm: Any, space: SpaceService) -> None:
    await space.close()
    one = await realm.start(Worker("one"))
    with pytest.raises(NoSpace, match="no space runs in this realm; start one: `robotree space serve jobs`"):
        await call(realm, one, "fetch")


async def test_of_several_spaces_one_is_named(realm: Any, one: Any) -> None:
    other = await start(realm, "plans")
    with pytest.raises(SeveralSpaces, match=r"\(jobs, plans\); say which: self\.space\['jobs'\]"):
        await call(realm, one, "fetch")
    await other.close()


async def test_a_space_that_dies_is_named(realm: Any, space: SpaceService, one: Any) -> None:
    taking = asyncio.create_task(call(realm, one, "fetch", within=50))
    await asyncio.sleep(1)
    realm.network.kill(space._transport)
    with pytest.raises(SpaceLost, match="space jobs has ended or hangs"):
        await taking
