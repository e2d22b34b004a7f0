"""A space as an agent, over each store, in real time: waiting, bells, what the dead leave."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.chance import token
from robotree.vr.base.errors import FenceHeld, Garbled, SpaceUnusable, TransactionOver
from robotree.vr.base.requests import (
    AcquireFence,
    AnyRequest,
    CloseTransaction,
    Done,
    EntriesCame,
    EntriesFound,
    EntryLeased,
    FenceGranted,
    FindEntries,
    GiveUp,
    OpenTransaction,
    RenewEntry,
    Reply,
    TransactionOpened,
    WatchEntries,
    WriteEntry,
)
from robotree.vr.exchange.asking import ask
from robotree.vr.space.postgres import PostgresStore
from robotree.vr.space.service import SpaceService
from robotree.vr.space.sqlite import SqliteStore
from robotree.vr.space.store import MemoryStore, SpaceStore
from robotree.vr.world.examine_space import job
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from tests.vr.space import stores
from tests.vr.space.postgres import Server
from tests.waiting import PATIENCE

AT_ONCE = 0.9
"""[s] Sooner than the next look of a store at what no bell has told."""


class Stage:
    """A network within the process, with services and programs that ask them."""

    def __init__(self, make: Callable[[], SpaceStore]) -> None:
        self.network = MemoryNetwork()
        self.make = make
        self.services: list[SpaceService] = []
        self.at_once = PATIENCE
        """[s] in which who waits is told; stores that also look by themselves have less."""

    async def serve(self, name: str = "jobs") -> SpaceService:
        service = SpaceService(self.network.join(name), name, self.make())
        await service.start()
        self.services.append(service)
        return service

    async def program(self, name: str) -> Program:
        transport = self.network.join(name)
        await transport.announce(f"caller/{name}")
        return Program(self, transport, f"caller/{name}")

    async def close(self) -> None:
        for service in self.services:
            await service.close()
            service._store.close()
        for transport in list(self.network.members):
            await transport.close()


class Program:
    """Asks spaces."""

    def __init__(self, stage: Stage, transport: MemoryTransport, key: str) -> None:
        self.stage, self.transport, self.key = stage, transport, key

    async def ask(self, request: AnyRequest, answer: type[Any], *, at: int = 0) -> Any:
        key = self.stage.services[at].address.key
        return await ask(self.transport, key, request, answer, timeout=PATIENCE, sender=self.key)

    async def write(self, number: int, *, at: int = 0, **options: Any) -> int:
        leased = await self.ask(WriteEntry(entry=job(number), **options), EntryLeased, at=at)
        return int(leased.id)

    async def take(self, within: float = 0.0, *, at: int = 0, **options: Any) -> list[int]:
        request = FindEntries(kind="Job", take=True, within=within, **options)
        found = await self.ask(request, EntriesFound, at=at)
        return [entry.fields["number"] for _, entry in found.entries]

    async def begin(self, term: float = 60.0) -> str:
        opened: TransactionOpened = await self.ask(OpenTransaction(term=term), TransactionOpened)
        return opened.transaction


@pytest.fixture(params=stores.KINDS)
async def stage(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[Stage]:
    url = ""
    make: Callable[[], SpaceStore] = lambda: MemoryStore("jobs", time.monotonic)  # noqa: E731
    if request.param == "sqlite":
        make = lambda: SqliteStore("jobs", tmp_path / "s.db", time.monotonic, time.time)  # noqa: E731
    elif request.param == "postgres":
        url = stores.schema_of(request.getfixturevalue("postgres"))
        make = lambda: PostgresStore("jobs", url)  # noqa: E731
    made = Stage(make)
    if url:
        made.at_once = AT_ONCE
    await made.serve()
    yield made
    await made.close()
    if url:
        stores.ring(url)


async def timed(work: Any) -> tuple[Any, float]:
    began = time.monotonic()
    return await work, time.monotonic() - began


async def test_who_waits_first_gets_the_entry_first(stage: Stage) -> None:
    one, other = await stage.program("one"), await stage.program("other")
    first = asyncio.create_task(one.take(PATIENCE))
    await asyncio.sleep(0.05)
    second = asyncio.create_task(other.take(PATIENCE))
    await asyncio.sleep(0.05)
    await one.write(1)
    assert (await timed(first))[1] < stage.at_once
    assert first.result() == [1]
    await one.write(2)
    assert await second == [2]


async def test_many_takers_of_many_writers_get_each_entry_once(stage: Stage) -> None:
    programs = [await stage.program(f"p{number}") for number in range(6)]
    taking = [asyncio.create_task(each.take(PATIENCE)) for each in programs for _ in range(20)]

    async def write(program: Program, numbers: range) -> None:
        for number in numbers:  # one after the other: a request that waits for 3 s is void
            await program.write(number)

    await asyncio.gather(*(write(each, range(m, 120, 6)) for m, each in enumerate(programs)))
    assert sorted(chain.from_iterable(await asyncio.gather(*taking))) == list(range(120))


async def test_what_was_given_up_is_there_again(stage: Stage) -> None:
    one = await stage.program("one")
    await one.write(1)
    given = token()
    assert await one.take(ask=given) == [1]
    await one.ask(GiveUp(ask=given), Done)
    assert await one.take() == [1]
    waiting = token()
    taking = asyncio.create_task(one.take(1.0, ask=waiting))
    await asyncio.sleep(0.05)
    await one.ask(GiveUp(ask=waiting), Done)
    await one.write(2)
    assert await one.take() == [2], "who gave up takes nothing"
    taking.cancel()


async def test_what_is_asked_again_under_its_key_is_done_once(stage: Stage) -> None:
    """As a robot does whose host was killed before it had the answer."""
    one = await stage.program("one")
    write, take, begin, commit = token(), token(), token(), token()
    assert await one.write(1, ask=write) == await one.write(1, ask=write)
    await one.write(2)
    assert await one.take(ask=take) == [1] == await one.take(ask=take)
    opened = [await one.ask(OpenTransaction(term=9, ask=begin), TransactionOpened) for _ in range(2)]
    assert opened[0] == opened[1]
    transaction = opened[0].transaction
    assert await one.take(transaction=transaction) == [2]
    for _ in range(2):
        await one.ask(CloseTransaction(transaction=transaction, ask=commit), Done)
    assert await one.take() == []


async def test_the_transaction_of_a_program_that_dies_is_taken_back(stage: Stage) -> None:
    one, other = await stage.program("one"), await stage.program("other")
    await one.write(1)
    transaction = await other.begin()
    assert await other.take(transaction=transaction) == [1]
    waiting = asyncio.create_task(one.take(PATIENCE))
    await asyncio.sleep(0.1)
    assert not waiting.done()
    stage.network.kill(other.transport)
    found, lasted = await timed(waiting)
    assert found == [1]
    assert lasted < stage.at_once


async def test_a_transaction_that_runs_out_is_taken_back_by_the_space(stage: Stage) -> None:
    one = await stage.program("one")
    await one.write(1)
    transaction = await one.begin(0.3)
    assert await one.take(transaction=transaction) == [1]
    found, lasted = await timed(one.take(PATIENCE))
    assert found == [1]
    assert 0.1 < lasted < 0.3 + stage.at_once
    with pytest.raises(TransactionOver):
        await one.ask(CloseTransaction(transaction=transaction), Done)


async def test_a_commit_wakes_those_who_wait(stage: Stage) -> None:
    one, other = await stage.program("one"), await stage.program("other")
    transaction = await one.begin()
    await one.write(1, transaction=transaction)
    waiting = asyncio.create_task(other.take(PATIENCE))
    await asyncio.sleep(0.1)
    await one.ask(CloseTransaction(transaction=transaction), Done)
    found, lasted = await timed(waiting)
    assert found == [1]
    assert lasted < stage.at_once


async def test_a_watch_tells_that_something_came_since_it_was_asked(stage: Stage) -> None:
    one = await stage.program("one")
    began = (await one.ask(WatchEntries(kind="Job"), EntriesCame)).number
    watching = asyncio.create_task(one.ask(WatchEntries(kind="Job", since=began, within=9), EntriesCame))
    await asyncio.sleep(0.05)
    await one.write(1)
    came, lasted = await timed(watching)
    assert came.came
    assert lasted < stage.at_once
    late = await one.ask(WatchEntries(kind="Job", since=began, within=9), EntriesCame)
    assert late.came, "what came before it was asked again is not missed"


async def test_a_fence_is_waited_for(stage: Stage) -> None:
    one, other = await stage.program("one"), await stage.program("other")
    first: FenceGranted = await one.ask(AcquireFence(name="door", term=0.4), FenceGranted)
    with pytest.raises(FenceHeld):
        await other.ask(AcquireFence(name="door", term=9.0), FenceGranted)
    acquiring = other.ask(AcquireFence(name="door", term=9.0, within=PATIENCE), FenceGranted)
    second, lasted = await timed(acquiring)
    assert second.epoch > first.epoch
    assert lasted < 0.4 + stage.at_once
    waiting = asyncio.create_task(one.ask(AcquireFence(name="door", term=9, within=9), FenceGranted))
    await asyncio.sleep(0.1)
    stage.network.kill(other.transport)
    third, lasted = await timed(waiting)
    assert third.epoch > second.epoch
    assert lasted < stage.at_once


async def test_a_lease_that_is_none_is_refused(stage: Stage) -> None:
    one = await stage.program("one")
    for term in (0.0, -1.0, float("nan")):
        with pytest.raises(Garbled, match="is no time of a lease"):
            await one.write(1, term=term)
    id_ = await one.write(1, term=5.0)
    with pytest.raises(Garbled):
        await one.ask(RenewEntry(id=id_, term=float("nan")), EntryLeased)


async def test_of_many_that_wait_for_the_same_few_are_tried() -> None:
    tried = 0

    class Counting(MemoryStore):
        def find(self, *values: Any, **options: Any) -> Any:
            nonlocal tried
            tried += 1
            return super().find(*values, **options)

    stage = Stage(lambda: Counting("jobs", time.monotonic))
    await stage.serve()
    one = await stage.program("one")
    taking = [asyncio.create_task(one.take(PATIENCE)) for _ in range(100)]
    await asyncio.sleep(0.1)
    tried = 0
    for number in range(10):
        await one.write(number)
    assert tried <= 20, "for each entry the one that gets it, and one in vain"
    for each in taking:
        each.cancel()
    await asyncio.gather(*taking, return_exceptions=True)
    await stage.close()


async def test_requests_that_come_together_are_kept_together(tmp_path: Path) -> None:
    """One commit for all that came while another one was under way (group commit)."""
    store = SqliteStore("jobs", tmp_path / "s.db", time.monotonic, time.time)
    service = SpaceService(MemoryNetwork().join(), "jobs", store)
    file, kept = store._file._file, list[str]()
    file.set_trace_callback(lambda order: kept.append(order) if order == "COMMIT" else None)
    answers: list[Reply] = []
    from robotree.vr.base.principal import ITSELF
    from robotree.vr.space.service import SpaceRequest

    for number in range(10):
        service._enter(SpaceRequest(WriteEntry(entry=job(number)), ITSELF, 0.0, answers.append))
    service._work_through()
    assert len(answers) == 10
    assert len(kept) == 1
    store.close()


# -- several processes over one database -----------------------------------------------------------


@pytest.fixture
async def pair(postgres: Server) -> AsyncIterator[Stage]:
    url = stores.schema_of(postgres)
    made = Stage(lambda: PostgresStore("jobs", url))
    made.at_once = AT_ONCE
    await made.serve("jobs-1")
    await made.serve("jobs-2")
    yield made
    await made.close()
    stores.ring(url)


async def test_two_services_of_one_database_ring_each_other(pair: Stage) -> None:
    one = await pair.program("one")
    await asyncio.sleep(0.2)  # both listen by then
    for number in range(3):
        waiting = asyncio.create_task(one.take(PATIENCE, at=1))
        await asyncio.sleep(0.05)
        await one.write(number, at=0)
        found, lasted = await timed(waiting)
        assert found == [number]
        assert lasted < pair.at_once


async def test_two_services_of_one_database_give_each_entry_once(pair: Stage) -> None:
    one = await pair.program("one")
    taking = [asyncio.create_task(one.take(PATIENCE, at=number % 2)) for number in range(40)]
    await asyncio.gather(*(one.write(number, at=number % 2) for number in range(40)))
    assert sorted(chain.from_iterable(await asyncio.gather(*taking))) == list(range(40))


async def test_what_the_service_of_a_transaction_leaves_its_lease_ends(pair: Stage) -> None:
    one = await pair.program("one")
    await one.write(1)
    transaction = await one.begin(1.0)
    assert await one.take(transaction=transaction) == [1]
    pair.network.kill(pair.services[0]._transport)
    assert await one.take(at=1) == []
    assert await one.take(PATIENCE, at=1) == [1]


async def test_a_database_that_cannot_be_reached_is_named_without_its_password() -> None:
    with pytest.raises(SpaceUnusable) as caught:
        PostgresStore("jobs", "postgresql://anna:secret@127.0.0.1:1/robots")
    assert "postgresql://127.0.0.1:1/robots cannot be used" in str(caught.value)
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)
