"""A machine that plays against stops: of any robot, at any moment, while bonds change and processes hang.

Whatever is on its way when: a robot that has confirmed a stop is not released by a resume that was asked for
before that.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, NamedTuple, TypeVar

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robotree.vr import Child, Robot, VirtualRobot
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.stops import Stops
from robotree.vr.base.errors import NotConfirmed, VrError
from robotree.vr.core import events as on
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner
from tests.machines.checkpoint import decoded

SETTLED = 30.0
"""[s] Longer than all orders, leases and silences together."""

R = TypeVar("R")


class Rover(Robot):
    """A rover, and whether its hardware is held."""

    held = False

    def safe_stop(self, reason: str) -> None:
        self.held = bool(reason)

    def resume(self) -> None:
        self.held = False


class Carrier(VirtualRobot):
    """Has up to two children."""

    front = Child("Robot")
    second = Child("Robot")


NAMES = ("carrier", "r1", "r2")
names = st.sampled_from(NAMES)
gaps = st.sampled_from([0.0005, 0.01, 0.07, 0.2, 0.45, 1.0, 4.0])
"""[s] Around one way, two and three, and what it takes to notice a silence."""


class Given(NamedTuple):
    """An order and what comes of it."""

    number: int
    name: str | None
    answer: asyncio.Task[tuple[set[str], set[str]]]
    """Who has confirmed it, and who has not."""


class StopMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.loop = VirtualLoop(VirtualRunner())
        self.stops: list[Given] = []
        self.resumes: list[Given] = []
        self.orders = 0

    @initialize(delay=st.sampled_from([0.01, 0.3]), deep=st.booleans())
    def begin(self, delay: float, *, deep: bool) -> None:
        self.run(self.open(delay, deep=deep))

    async def open(self, delay: float, *, deep: bool) -> None:
        self.network = MemoryNetwork(delay=delay, lease=2.0)
        robots = (Carrier("carrier"), Carrier("r1") if deep else Rover("r1"), Rover("r2"))
        self.members = {robot.name: self.network.join(robot.name) for robot in robots}
        self.agents = {robot.name: RobotAgent(robot, self.members[robot.name]) for robot in robots}
        for agent in self.agents.values():
            await agent.start()
        self.supervisor: MemoryTransport = self.network.join("supervisor")
        self.realm_client = RealmClient(self.supervisor)
        await self.realm_client.start()
        await self.realm_client.enslave("carrier", "front", "r1")
        await self.realm_client.stop(None)

    def run(self, work: Coroutine[Any, Any, R]) -> R:
        asyncio.set_event_loop(self.loop)
        return self.loop.run_until_complete(work)

    def teardown(self) -> None:
        self.run(self.end())
        asyncio.set_event_loop(None)
        self.loop.close()

    async def end(self) -> None:
        try:
            await self.settle()
            await self.judge()
            await self.realm_client.resume(None)
            await self.settle()
            for name, agent in self.agents.items():
                assert not agent.description().stopped, f"{name} is released when all are awake and asked"
        finally:
            await self.realm_client.close()
            rest = asyncio.all_tasks() - {asyncio.current_task()}
            for agent in self.agents.values():
                await agent.close()
            for task in rest:
                task.cancel()
            await asyncio.gather(*rest, return_exceptions=True)

    async def settle(self) -> None:
        for member in self.members.values():
            self.network.thaw(member)
        await asyncio.gather(*(given.answer for given in (*self.stops, *self.resumes)))
        await asyncio.sleep(SETTLED)

    # -- what people do ---------------------------------------------------------------------------

    @rule(name=st.none() | names)
    def stop(self, name: str | None) -> None:
        self.stops.append(self.give(name, self.realm_client.stop(name)))

    @rule(name=st.none() | names)
    def resume(self, name: str | None) -> None:
        self.resumes.append(self.give(name, self.realm_client.resume(name)))

    @rule(first=st.none() | names, then=st.none() | names, gap=gaps)
    def stop_all_then_resume_and_stop(self, first: str | None, then: str | None, gap: float) -> None:
        """What chance alone does too seldom: a resume and a stop are on their way at once."""
        self.stop(None)
        self.wait(4.0)
        self.resume(first)
        self.wait(gap)
        self.stop(then)
        self.wait(4.0)

    def give(self, name: str | None, order: Coroutine[Any, Any, Any]) -> Given:
        async def follow() -> tuple[set[str], set[str]]:
            try:
                return set(await order), set()
            except NotConfirmed as error:
                return set(error.data["told"]), {untold for untold, _ in error.data["untold"]}
            except VrError:
                return set(), set()

        self.orders += 1
        given = Given(self.orders, name, self.loop.create_task(follow()))
        self.run(asyncio.sleep(0))  # it is asked for now, not when the next rule runs
        return given

    @rule(parent=st.sampled_from(["carrier", "r1"]), slot=st.sampled_from(["front", "second"]), child=names)
    def enslave(self, parent: str, slot: str, child: str) -> None:
        self.run(self.whatever(self.realm_client.enslave(parent, slot, child)))

    @rule(parent=st.sampled_from(["carrier", "r1"]), slot=st.sampled_from(["front", "second"]))
    def release(self, parent: str, slot: str) -> None:
        self.run(self.whatever(self.realm_client.release(parent, slot)))

    async def whatever(self, work: Coroutine[Any, Any, object]) -> None:
        task = self.loop.create_task(work)
        await asyncio.wait([task], timeout=0.2)  # and it goes on
        task.add_done_callback(lambda done: done.cancelled() or done.exception())

    @rule(name=names, frozen=st.booleans())
    def freeze_or_thaw(self, name: str, *, frozen: bool) -> None:
        async def act() -> None:
            (self.network.freeze if frozen else self.network.thaw)(self.members[name])

        self.run(act())

    @rule()
    def go_on_from_the_encoded_states(self) -> None:
        for agent in self.agents.values():
            agent.runtime.core.state = decoded(agent.runtime.core.state)
            self.run(self.begin_anew(agent))

    async def begin_anew(self, agent: RobotAgent) -> None:
        """The restored state does not contain which parts its stops have asked."""
        agent._stops = Stops(agent.runtime, agent._hooks, agent._children)
        agent.runtime.post(on.Restored())

    @rule(seconds=gaps)
    def wait(self, seconds: float) -> None:
        self.run(asyncio.sleep(seconds))

    # -- the laws ---------------------------------------------------------------------------------

    @invariant()
    def who_has_confirmed_a_stop_is_stopped_until_a_later_release(self) -> None:
        if hasattr(self, "agents"):
            self.run(self.judge())

    async def judge(self) -> None:
        for name, agent in self.agents.items():
            confirmed = [given for given in self.stops if given.answer.done()]
            stopped = [given.number for given in confirmed if name in given.answer.result()[0]]
            resumed = [given.number for given in self.resumes if self.may_concern(given, name)]
            if stopped and max(stopped) > max(resumed, default=0):
                assert agent.description().stopped, f"{name} was released by what was asked for before"
                assert getattr(agent.robot, "held", True), f"so was the hardware of {name}"

    def may_concern(self, order: Given, name: str) -> bool:
        """Whether an order is meant for a robot, or for one that may be above it."""
        return order.name in {None, name} or isinstance(self.agents[order.name].robot, Carrier)


TestStopMachine = StopMachine.TestCase
TestStopMachine.settings = settings(max_examples=60, stateful_step_count=15, deadline=None)
