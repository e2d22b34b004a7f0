"""A machine that plays against directories, a rover and people, with partitions and kills.

Whatever is cut off, killed or cancelled: nothing is carried out twice, an order whose cancel all holders have
confirmed is not carried out, nothing begins while a stop holds the rover, and when things have settled all
directories say the same.
"""

from __future__ import annotations

import asyncio
import contextlib
import tempfile
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, TypeVar

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from robotree.vr.base.errors import VrError
from robotree.vr.orders.ledger import Ledger
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner
from tests.vr.orders.conftest import Rover, Stage

SETTLED = 60.0
"""[s] Longer than all terms of directories and takers together."""
NAMES = ("d1", "d2", "d3")

R = TypeVar("R")


class OrderMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.loop = VirtualLoop(VirtualRunner())
        self.folder = tempfile.TemporaryDirectory()
        self.begun: list[str] = []
        """Keys of the motions that have begun, over all lives of the rover."""
        self.keys: list[str] = []
        self.safe: dict[str, int] = {}
        """Keys of cancelled orders that all holders confirmed, and how often each had begun by then."""
        self.ledger = Ledger(None)
        self.agent: Any = None
        self.run(self._open())

    async def _open(self) -> None:
        self.stage = Stage(Path(self.folder.name))
        for name in NAMES:
            await self.stage.directory(name)
        self.person = await self.stage.person()
        await self._switch_on()
        await self.stage.until(lambda: all(each.book.store.agents for each in self.stage.services))
        await self._switch_off()

    def run(self, work: Coroutine[Any, Any, R]) -> R:
        asyncio.set_event_loop(self.loop)
        return self.loop.run_until_complete(work)

    async def _switch_on(self) -> None:
        if self.agent is None:
            rover = Rover("r1")
            rover.done = self.begun
            self.agent = await self.stage.robot(rover, self.ledger)

    async def _switch_off(self) -> None:
        if self.agent is not None:
            agent, self.agent = self.agent, None
            await self.stage.switch_off(agent)

    # -- what happens -----------------------------------------------------------------------------

    @rule(repeat=st.booleans(), seconds=st.sampled_from([0.1, 2.0]))
    def leave(self, *, repeat: bool, seconds: float) -> None:
        async def leave() -> None:
            command = "go_to" if repeat else "drive"
            left = await self.person.orders.leave(
                "r1", command, {"x": 1.0, "seconds": seconds}, begin_within=3000.0
            )
            self.keys.append(left.order.key)

        self._try(leave())

    @precondition(lambda self: self.keys)
    @rule(number=st.integers(0, 20))
    def cancel(self, number: int) -> None:
        key = self.keys[number % len(self.keys)]

        async def cancel() -> None:
            answer = await self.person.orders.cancel(key)
            if answer.order.state == "cancelled" and not answer.unconfirmed:
                self.safe.setdefault(key, self.begun.count(key))

        self._try(cancel())

    @rule(name=st.sampled_from(NAMES))
    def kill_or_start_a_directory(self, name: str) -> None:
        async def change() -> None:
            found = [each for each in self.stage.services if each.address.name == name]
            if found and len(self.stage.services) > 1:
                await self.stage.kill_directory(found[0])
            elif not found:
                await self.stage.directory(name)

        self.run(change())

    @rule(one=st.sampled_from((*NAMES, "r1", "operator")), other=st.sampled_from(NAMES))
    def part(self, one: str, other: str) -> None:
        ways = self.stage.transports
        if one != other and one in ways and other in ways:
            self.stage.network.cut(ways[one], ways[other])

    @rule()
    def heal(self) -> None:
        ways = list(self.stage.transports.values())
        for one in ways:
            for other in ways:
                if one is not other:
                    self.stage.network.heal(one, other)

    @rule(on=st.booleans())
    def switch(self, *, on: bool) -> None:
        self.run(self._switch_on() if on else self._switch_off())

    @rule(seconds=st.sampled_from([0.05, 0.5, 3.0, 10.0]))
    def wait(self, seconds: float) -> None:
        self.run(asyncio.sleep(seconds))

    @rule()
    def stop_and_look(self) -> None:
        """A hold that every directory has confirmed keeps the rover still until it is released."""

        async def stop() -> None:
            living = [each.address.name for each in self.stage.services]
            holding, silent = await self.person.orders.hold()
            if silent or sorted(holding) != sorted(living) or len(living) != len(NAMES):
                await self.person.orders.release()
                return
            await self._switch_off()
            before = len(self.begun)
            await self._switch_on()
            await asyncio.sleep(20.0)
            assert len(self.begun) == before, "it began while a stop held it"
            await self.person.orders.release()

        self._try(stop())

    def _try(self, work: Coroutine[Any, Any, None]) -> None:
        async def attempt() -> None:
            with contextlib.suppress(VrError):  # nobody answers at the moment, or it is over
                await work

        self.run(attempt())

    # -- what must hold ---------------------------------------------------------------------------

    def teardown(self) -> None:
        self.heal()
        self.run(self._settle())
        try:
            self._check()
        finally:
            self.run(self.stage.close())
            asyncio.set_event_loop(None)
            self.loop.close()
            self.folder.cleanup()

    async def _settle(self) -> None:
        for name in NAMES:
            if not any(each.address.name == name for each in self.stage.services):
                await self.stage.directory(name)
        await self._switch_on()
        await asyncio.sleep(2.0)
        await self.person.orders.release()
        await asyncio.sleep(SETTLED)

    def _check(self) -> None:
        first, *others = [each.book.store for each in self.stage.services]
        for other in others:
            assert first.orders == other.orders
            assert first.holds == other.holds
        for key in self.keys:
            order = first.orders[key]
            assert order.over, f"{order.command} is {order.state}"
            if order.command == "drive":
                assert self.begun.count(key) <= 1, "it was carried out twice"
            if order.state in {"refused", "cancelled", "expired"}:
                assert not self.begun.count(key)
            if order.state == "done":
                assert self.begun.count(key) >= 1
        for key, count in self.safe.items():
            assert self.begun.count(key) == count, "all had confirmed the cancel"


OrderMachine.TestCase.settings = settings(max_examples=12, stateful_step_count=18, deadline=None)
TestOrders = OrderMachine.TestCase
