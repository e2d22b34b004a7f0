"""Real time is kept by absolute deadlines; a debt is made good, or dropped and counted when too large."""

from __future__ import annotations

import queue
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import Heartbeat, LocalPositionNed
from robotree.sim.controller.controller import Controller
from robotree.sim.firmware import Outgoing
from robotree.sim.kinds import kind
from robotree.sim.serving.realtime import FASTEST, LARGEST_DEBT, Pacer, RealTime
from tests.waiting import wait_until

PERIOD = 0.005


@given(costs=st.lists(st.floats(0.0, PERIOD), min_size=1, max_size=200))
def test_whatever_a_batch_costs_below_its_period_no_time_is_lost(costs: list[float]) -> None:
    now = 100.0
    pacer = Pacer(PERIOD, now)
    for cost in costs:
        now += cost
        now += pacer.wait(now)
    assert now == pytest.approx(100.0 + PERIOD * len(costs), abs=1e-6)
    assert pacer.dropped == 0.0


@given(stall=st.floats(PERIOD, LARGEST_DEBT), cost=st.floats(0.0, 0.9 * PERIOD / FASTEST))
def test_a_stall_is_made_good_by_a_clock_that_never_jumps(stall: float, cost: float) -> None:
    pacer = Pacer(PERIOD, 0.0)
    now, batches, began = stall, 1, -PERIOD
    while (begins := now + pacer.wait(now)) > batches * PERIOD + 1e-9:
        assert begins - began >= PERIOD / FASTEST - 1e-9
        began, now, batches = begins, begins + cost, batches + 1
    debt_per_batch = PERIOD - PERIOD / FASTEST
    assert batches == pytest.approx(stall / debt_per_batch, abs=3 + PERIOD / debt_per_batch)
    assert pacer.dropped == 0.0


def test_a_controller_that_was_late_does_not_hurry_through_its_goals() -> None:
    class Late(Controller):
        def advance(self) -> list[Outgoing]:
            begins.append(time.monotonic())
            if len(begins) == 10:
                time.sleep(LARGEST_DEBT - 0.05)
            return []

    begins: list[float] = []
    whole = kind("rover").build(1, 2.0)
    running = RealTime(Late(whole.cell, whole.firmware, {}), lambda _: None, lambda _: None)
    while len(begins) < 60:
        time.sleep(0.01)
    running.close()
    assert begins[50] - begins[11] >= 0.75 * 39 * PERIOD  # a goal of 0.4 s lasts 0.3 s at least


@given(nap=st.floats(LARGEST_DEBT + 2 * PERIOD, 1e6))
def test_a_long_sleep_is_dropped_and_counted(nap: float) -> None:
    pacer = Pacer(PERIOD, 0.0)
    assert pacer.wait(nap) == 0.0
    assert pacer.dropped == pytest.approx(nap - PERIOD)
    assert pacer.wait(nap + 0.001) == pytest.approx(PERIOD - 0.001, abs=1e-6)


@pytest.mark.parametrize(("speedup", "batches"), [(1.0, 1), (0.5, 1), (2.5, 2), (3.0, 3)])
def test_the_thread_of_a_world_that_runs_faster_wakes_no_more_often(
    monkeypatch: pytest.MonkeyPatch, speedup: float, batches: int
) -> None:
    class Counted(Controller):
        def advance(self) -> list[Outgoing]:
            begun.append("batch")
            return []

    def wait(pacer: Pacer, now: float) -> float:
        begun.append("sleep")
        return waits(pacer, now)

    begun: list[str] = []
    waits = Pacer.wait
    monkeypatch.setattr(Pacer, "wait", wait)
    whole = kind("rover").build(1, 2.0)
    running = RealTime(Counted(whole.cell, whole.firmware, {}), lambda _: None, lambda _: None, speedup)
    wait_until(lambda: len(begun) > 40, "it runs")
    running.close()
    assert begun[: 4 * (batches + 1)] == 4 * [*batches * ["batch"], "sleep"]
    assert running._period == pytest.approx(batches * PERIOD / speedup)


def test_a_cell_runs_in_its_thread_until_it_is_closed() -> None:
    told: queue.SimpleQueue[list[Outgoing]] = queue.SimpleQueue()
    failures: list[Exception] = []
    controller = kind("rover").build(1, 2.0)
    controller.greet("a link")
    running = RealTime(controller, told.put, failures.append)
    seen: set[type] = set()
    while not {Heartbeat, LocalPositionNed} <= seen:
        seen |= {type(outgoing.message) for outgoing in told.get(timeout=60)}
    running.close()
    time_ms = running.pace.time_ms
    assert time_ms > 0
    assert running.pace.time_ms == time_ms
    assert not failures


def test_what_ends_the_physics_is_told() -> None:
    class Broken(Controller):
        def advance(self) -> list[Outgoing]:
            raise FloatingPointError("the world fell apart")

    whole = kind("rover").build(1, 2.0)
    failures: queue.SimpleQueue[Exception] = queue.SimpleQueue()
    running = RealTime(Broken(whole.cell, whole.firmware, {}), lambda _: None, failures.put)
    assert isinstance(failures.get(timeout=60), FloatingPointError)
    running.close()


@pytest.mark.speed
def test_the_physics_is_ten_times_faster_than_real_time() -> None:
    """Measured in this thread's processor time, so that a busy machine does not matter; the best of five."""
    cell = kind("arm").build(1, 2.0).cell
    costs = []
    for _ in range(5):
        began = time.thread_time()
        for _ in range(100):
            cell.advance()
        costs.append(time.thread_time() - began)
    assert 0.5 / min(costs) >= 10.0
