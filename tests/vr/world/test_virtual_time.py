"""The World: greenlets, event loops and simulated processes in virtual time, all from one seed."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import random
import sys
import weakref
from collections.abc import AsyncGenerator, Callable
from functools import partial

import pytest

from robotree.vr.base import chance
from robotree.vr.base.description import Listing
from robotree.vr.exchange.asking import fresh_key
from robotree.vr.exchange.claim import new_address
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.running.runner import Runner, Threads
from robotree.vr.world.virtual_loop import VirtualLoop, run_in_virtual_time
from robotree.vr.world.virtual_runner import (
    BEGINNING,
    VirtualProcess,
    VirtualRunner,
    VirtualWaiter,
    virtual_runner,
)
from robotree.vr.world.world import SimulatedProcess, World


def test_the_same_seed_gives_the_same_order_and_another_seed_another_one() -> None:
    def order(seed: int) -> list[tuple[float, int]]:
        told: list[tuple[float, int]] = []
        with virtual_runner(seed) as runner:

            def walk(who: int) -> None:
                waiter = runner.waiter()
                for _ in range(5):
                    waiter.wait(runner.random() if who % 2 else 0.5)
                    told.append((runner.now(), who))

            for who in range(6):
                runner.spawn(lambda who=who: walk(who), "walker")  # type: ignore[misc]
            runner.run(10.0)
        return told

    assert order(1) == order(1)
    assert order(1) != order(2)


@pytest.mark.parametrize("make", [Threads, VirtualRunner], ids=["threads", "virtual"])
def test_a_wake_before_the_wait_is_kept_and_two_are_one(make: Callable[[], Runner]) -> None:
    waiter = make().waiter()
    waiter.wake()
    waiter.wake()
    assert waiter.wait(1.0)
    assert not waiter.wait(0.001)


def test_an_early_timer_of_a_waiter_does_not_end_a_later_wait() -> None:
    with virtual_runner() as runner:
        waiter = runner.waiter()
        runner.at(0.5, waiter.wake)
        assert waiter.wait(1.0)
        assert not waiter.wait(10.0)
        assert runner.now() == 10.5
        assert not waiter.wait(0.25)
        assert runner.now() == 10.75


def test_waiting_with_a_lock_and_locking_twice_are_errors() -> None:
    with virtual_runner() as runner:
        with runner.lock(), pytest.raises(RuntimeError, match="holds a lock"):
            runner.waiter().wait(1.0)
        with runner.lock(), pytest.raises(RuntimeError, match="while it holds one"), runner.lock():
            pass


def test_what_a_greenlet_or_an_action_raises_is_raised_where_the_world_is_run() -> None:
    def fail() -> None:
        raise ValueError("on purpose")

    with virtual_runner() as runner:
        runner.spawn(fail, "fails")
        with pytest.raises(ValueError, match="on purpose"):
            runner.run(1.0)
        runner.at(2.0, fail)
        with pytest.raises(ValueError, match="on purpose"):
            runner.run(3.0)
        runner.run(3.0)
        assert runner.now() == 3.0


def test_a_world_in_which_nothing_can_happen_says_so() -> None:
    with virtual_runner() as runner, pytest.raises(RuntimeError, match="nothing will ever happen"):
        runner.waiter().wait(None)


def beats(process: VirtualProcess, told: list[float]) -> Callable[[], None]:
    def beat() -> None:
        waiter = process.waiter()
        while True:
            waiter.wait(1.0)
            told.append(process.runner.now())

    return beat


def test_a_paused_process_does_nothing_until_it_goes_on_and_an_ended_one_never_again() -> None:
    told: list[float] = []
    with virtual_runner() as runner:
        process = VirtualProcess(runner, "p")
        process.spawn(beats(process, told), "beat")
        runner.at(2.5, process.pause)
        runner.at(7.25, process.resume)
        runner.at(9.5, process.end)
        runner.at(10.0, process.resume)
        runner.run(20.0)
        assert told == [1.0, 2.0, 7.25, 8.25, 9.25]


def test_the_finally_of_an_ended_process_runs_only_when_the_world_ends() -> None:
    told: list[str] = []
    with virtual_runner() as runner:
        process = VirtualProcess(runner, "p")

        def work() -> None:
            try:
                process.waiter().wait(5.0)
            finally:
                told.append("tidied up")
                process.waiter().wait(5.0)
                told.append("never")

        process.spawn(work, "work")
        runner.at(1.0, process.end)
        runner.run(20.0)
        assert told == []
    assert told == ["tidied up"]


def test_each_process_has_its_own_clocks() -> None:
    told: list[float] = []
    with virtual_runner() as runner:
        process = VirtualProcess(runner, "p", skew=-3.0, rate=1.25, offset=100.0)
        process.spawn(beats(process, told), "beat")
        runner.run(4.0)
        assert told == pytest.approx([0.8, 1.6, 2.4, 3.2])
        assert process.now() == 105.0
        assert process.unix() == BEGINNING + 5.0 - 3.0


def test_a_day_of_an_event_loop_passes_at_once_with_its_thread_pool() -> None:
    async def story() -> float:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        waiter = loop.runner.waiter()
        asleep = asyncio.to_thread(waiter.wait, 3600.0)
        async with asyncio.timeout(7200.0):
            assert not await asleep
        await asyncio.sleep(23 * 3600.0)
        return loop.time()

    assert run_in_virtual_time(story()) == 24 * 3600.0


def test_what_a_pool_thread_raises_reaches_the_one_who_waits() -> None:
    def fail() -> None:
        raise ValueError("on purpose")

    async def story() -> None:
        with pytest.raises(ValueError, match="on purpose"):
            await asyncio.to_thread(fail)

    run_in_virtual_time(story())


def test_several_loops_run_beside_each_other_and_know_which_is_theirs() -> None:
    told: list[tuple[float, str]] = []
    with virtual_runner() as runner:

        async def tick(loop: VirtualLoop, name: str, every: float) -> None:
            for _ in range(3):
                await asyncio.sleep(every)
                assert asyncio.get_running_loop() is loop
                told.append((loop.time(), name))

        loops = [VirtualLoop(VirtualProcess(runner, name)) for name in "ab"]
        for loop, name, every in zip(loops, "ab", (1.0, 1.5), strict=True):
            runner.spawn(
                lambda loop=loop, name=name, every=every: loop.run_until_complete(tick(loop, name, every)),
                name,
            )  # type: ignore[misc]
        runner.run(10.0)
        assert sorted(told) == [(1.0, "a"), (1.5, "b"), (2.0, "a"), (3.0, "a"), (3.0, "b"), (4.5, "b")]
        for loop in loops:
            loop.close()


def test_a_task_that_waits_in_its_turn_twice_is_the_current_one_each_time_it_goes_on() -> None:
    current: list[tuple[str, bool]] = []
    with virtual_runner() as runner:

        async def work(waiter: VirtualWaiter, name: str) -> None:
            task = asyncio.current_task()
            await asyncio.sleep(0.1)
            for _ in range(3):
                waiter.wait(1.0)  # not awaited: the loop of the task stands still, the others turn
                current.append((name, asyncio.current_task() is task))

        def live(process: VirtualProcess, name: str) -> None:
            loop = VirtualLoop(process)
            loop.run_until_complete(work(process.waiter(), name))
            loop.close()

        for name in "abc":
            runner.spawn(partial(live, VirtualProcess(runner, name), name), name)
        runner.run(10.0)
    assert sorted(current) == [(name, True) for name in "abc" for _ in range(3)]


def test_a_dropped_loop_leaves_nothing_behind() -> None:
    told: list[str] = []

    async def work() -> None:
        try:
            await asyncio.sleep(100.0)
        finally:
            told.append("closed")

    runner = VirtualRunner()
    process = VirtualProcess(runner, "p")
    loop = VirtualLoop(process)
    process.spawn(lambda: loop.run_until_complete(asyncio.wait([loop.create_task(work())])), "loop")
    runner.at(1.0, process.end)
    runner.run(2.0)
    loop.drop()
    runner.close()
    assert told == ["closed"]
    assert loop.is_closed()


# -- simulated processes: one seed, one trace, whatever happens to them ----------------------------


async def lookup(process: SimulatedProcess) -> None:
    await LookupService(process.transport, process.name).start()
    await asyncio.Event().wait()


async def robot(process: SimulatedProcess) -> None:
    """Be present and listed."""
    address = new_address("robot", process.name)
    await process.transport.announce(address.key)
    await Registrar(process.transport).enter(Listing(address=address, kinds=("Robot",)))
    await asyncio.Event().wait()


class Realm:
    """Two lookups, three robots, and one that looks, in trouble by chance."""

    def __init__(self, world: World) -> None:
        self.world, self.seen = world, list[str]()
        self.chance = random.Random(world.seed)
        self.mains = {"lookup-1": lookup, "lookup-2": lookup, "a": robot, "b": robot, "c": robot}
        self.processes = {name: world.start(name, main) for name, main in self.mains.items()}
        world.start("looks", self._look)

    async def _look(self, process: SimulatedProcess) -> None:
        directory = Directory(process.transport)
        await directory.start()
        while True:
            await asyncio.sleep(1.0)
            self.seen = [listing.name for listing in directory.listings]
            self.world.note("looks", "sees", tuple(self.seen))

    def trouble(self) -> None:
        name = self.chance.choice(list(self.processes))
        process = self.processes[name]
        what = self.chance.choice([process.kill, process.vanish, process.pause])
        what()
        self.world.runner.at(self.world.runner.now() + self.chance.uniform(0.5, 4.0), lambda: self.heal(name))

    def heal(self, name: str) -> None:
        process = self.processes[name]
        process.resume()
        if not process.alive:
            self.processes[name] = self.world.start(name, self.mains[name])


def play(seed: int) -> tuple[str, list[str]]:
    with World(seed) as world:
        realm = Realm(world)
        world.network.weather.jitter = 0.05
        for _ in range(6):
            world.runner.at(realm.chance.uniform(2.0, 20.0), realm.trouble)
        world.run(40.0)
        assert world.complaints == []
        return world.digest, realm.seen


@pytest.mark.parametrize("seed", range(3))
def test_a_seed_gives_one_trace_and_all_is_whole_in_the_end(seed: int) -> None:
    digest, seen = play(seed)
    assert seen == ["a", "b", "c"]
    assert play(seed)[0] == digest
    assert play(seed + 100)[0] != digest


def test_a_process_that_returns_is_gone_for_the_others() -> None:
    told: list[str] = []

    async def short(process: SimulatedProcess) -> None:
        await process.transport.announce("robot/x/1")
        await asyncio.sleep(1.0)

    async def watcher(process: SimulatedProcess) -> None:
        process.transport.presence.watch("robot/*/*", lambda key, there: told.append(f"{key} {there}"))
        await asyncio.Event().wait()

    with World(1) as world:
        world.start("watcher", watcher)
        process = world.start("short", short)
        world.run(5.0)
        assert told == ["robot/x/1 True", "robot/x/1 False"]
        assert not process.alive


def test_what_a_process_raises_ends_the_world() -> None:
    async def fails(_: SimulatedProcess) -> None:
        raise ValueError("on purpose")

    with World(1) as world:
        world.start("fails", fails)
        with pytest.raises(ValueError, match="on purpose"):
            world.run(1.0)


def test_what_is_asked_of_a_process_from_outside_is_noted() -> None:
    async def idle(_: SimulatedProcess) -> None:
        await asyncio.Event().wait()

    with World(1) as world:
        process = world.start("idle", idle)
        world.runner.at(1.0, lambda: process.do(lambda: process.transport.presence.hanging("**"), "hanging"))
        world.run(2.0)
        assert (1.0, "idle", "hanging done", "[]") in world.trace


def test_a_world_that_has_ended_can_be_forgotten() -> None:
    """A greenlet that was never ended would keep all that its frames know, for ever."""

    async def main(_: SimulatedProcess) -> None:
        await asyncio.sleep(1.0)

    def play() -> weakref.ref[World]:
        with World(1) as world:
            world.start("one", main)
            world.run(2.0)
        return weakref.ref(world)

    gc.freeze()  # what was there before need not be looked through
    forgotten = play()
    gc.collect()
    gc.unfreeze()
    assert forgotten() is None


def test_what_a_killed_process_had_opened_does_not_go_on_when_the_world_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its `finally` blocks wait; collected later, they would ask a loop for that which is closed."""
    left: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", left.append)
    ended: list[str] = []
    kept: list[contextlib.AbstractAsyncContextManager[None]] = []

    @contextlib.asynccontextmanager
    async def opened() -> AsyncGenerator[None]:
        try:
            yield
        finally:
            try:
                await asyncio.sleep(1.0)
            finally:
                ended.append("first")
                await asyncio.sleep(1.0)

    async def main(_: SimulatedProcess) -> None:
        kept.append(opened())  # as a cycle of references would
        async with kept[0]:
            await asyncio.Event().wait()

    gc.freeze()  # as above
    with World(1) as world:
        process = world.start("one", main)
        world.runner.at(1.0, process.kill)
        world.run(2.0)
        assert ended == []
    assert ended == ["first"]
    kept.clear()
    gc.collect()
    gc.unfreeze()
    assert left == []


# -- keys and addresses come from the operating system, or in the World from the seed --------------


def test_nobody_draws_the_same_key_twice() -> None:
    assert len({fresh_key() for _ in range(1000)}) == 1000


def test_the_same_seed_gives_the_same_keys_and_addresses() -> None:
    def draw() -> tuple[str, str]:
        with chance.drawn_from(random.Random(7).getrandbits):
            return fresh_key(), new_address("robot", "arm").key

    assert draw() == draw()
    assert fresh_key() not in draw()
