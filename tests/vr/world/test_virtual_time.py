"""Greenlets and event loops in virtual time, from a seed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial

import pytest

from robotree.vr.running.runner import Runner, Threads
from robotree.vr.world.virtual_loop import VirtualLoop, run_in_virtual_time
from robotree.vr.world.virtual_runner import (
    BEGINNING,
    VirtualProcess,
    VirtualRunner,
    VirtualWaiter,
    virtual_runner,
)


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
