"""Simulated processes: one seed, one trace, whatever happens to them."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import random
import sys
import weakref
from collections.abc import AsyncGenerator

import pytest

from robotree.vr.base.description import Listing
from robotree.vr.exchange.claim import new_address
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.world.world import SimulatedProcess, World


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
