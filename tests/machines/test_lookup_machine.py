"""A machine that plays against lookup.

Whatever dies, stops, is cut off or changes its mind: when things have settled, all tables and all onlookers
agree with the truth.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

import msgspec
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, Template
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner

SETTLED = 20.0
"""[s] Longer than retry, renewal and comparison together."""

R = TypeVar("R")


class Agent:
    def __init__(self, transport: MemoryTransport, name: str, registrar: Registrar | None = None) -> None:
        self.transport = transport
        self.registrar = registrar or Registrar(transport, chance=lambda: 0.5)
        self.listing = Listing(address=Address("robot", name, "1"), kinds=("Robot",))
        self.free = True

    async def start(self) -> None:
        await self.transport.announce(self.listing.address.key)
        await self.registrar.enter(self.listing)

    async def show(self) -> None:
        if self.free:
            await self.registrar.enter(self.listing)
        else:
            await self.registrar.leave(self.listing.address)


class LookupMachine(RuleBasedStateMachine):
    lookups = Bundle("lookups")
    agents = Bundle("agents")

    def __init__(self) -> None:
        super().__init__()
        self.loop = VirtualLoop(VirtualRunner())
        self.network = self.make_network()
        self.number = 0
        self.living_lookups: list[LookupService] = []
        self.living_agents: list[Agent] = []
        self.onlooker_transport = self.network.join("onlooker")
        self.onlooker = Directory(self.onlooker_transport)
        self.run(self.onlooker.start())

    def make_network(self) -> MemoryNetwork:
        return MemoryNetwork(delay=0.002, loop=self.loop)

    def run(self, work: Coroutine[Any, Any, R]) -> R:
        asyncio.set_event_loop(self.loop)
        return self.loop.run_until_complete(work)

    def teardown(self) -> None:
        async def end() -> None:
            for lookup in self.living_lookups:
                await lookup.close()
            for agent in self.living_agents:
                await agent.registrar.close()
            await self.onlooker.close()
            rest = asyncio.all_tasks() - {asyncio.current_task()}
            for task in rest:
                task.cancel()
            await asyncio.gather(*rest, return_exceptions=True)

        self.run(end())
        asyncio.set_event_loop(None)
        self.loop.close()

    # -- what people do ---------------------------------------------------------------------------

    @rule(target=lookups)
    def open_lookup(self) -> LookupService:
        self.number += 1

        async def begin() -> LookupService:
            service = LookupService(self.network.join(), f"lookup-{self.number}")
            await service.start()
            return service

        self.living_lookups.append(self.run(begin()))
        return self.living_lookups[-1]

    @rule(target=agents)
    def start_agent(self) -> Agent:
        self.number += 1

        async def begin() -> Agent:
            agent = Agent(self.network.join(), f"robot-{self.number}")
            await agent.start()
            return agent

        self.living_agents.append(self.run(begin()))
        return self.living_agents[-1]

    @rule(target=agents, neighbour=agents)
    def start_agent_in_the_same_process(self, neighbour: Agent) -> Agent:
        self.number += 1
        agent = Agent(neighbour.transport, f"robot-{self.number}", neighbour.registrar)
        if neighbour in self.living_agents:
            self.run(agent.start())
            self.living_agents.append(agent)
        return agent

    @rule(agent=agents, free=st.booleans())
    def bind_or_free(self, agent: Agent, *, free: bool) -> None:
        agent.free = free
        if agent in self.living_agents:
            self.run(agent.show())

    @rule(agent=agents, doc=st.sampled_from(["", "a", "b"]))
    def change(self, agent: Agent, doc: str) -> None:
        agent.listing = msgspec.structs.replace(agent.listing, doc=doc)
        if agent in self.living_agents:
            self.run(agent.show())

    @rule(agent=agents, docs=st.lists(st.sampled_from(["c", "d", None]), min_size=2, max_size=4))
    def change_quickly(self, agent: Agent, docs: list[str | None]) -> None:
        """Without waiting for one change before the next."""
        if agent not in self.living_agents:
            return

        async def hurry() -> None:
            shown = []
            for doc in docs:
                agent.free = doc is not None
                agent.listing = msgspec.structs.replace(agent.listing, doc=doc or "")
                shown.append(asyncio.ensure_future(agent.show()))
                await asyncio.sleep(0)
            await asyncio.gather(*shown)

        self.run(hurry())

    # -- what happens to them ---------------------------------------------------------------------

    @rule(lookup=consumes(lookups))
    def kill_lookup(self, lookup: LookupService) -> None:
        self.living_lookups.remove(lookup)
        self.run(self.kill(lookup._transport))

    @rule(agent=consumes(agents))
    def kill_agent(self, agent: Agent) -> None:
        if agent in self.living_agents:
            self.living_agents = [one for one in self.living_agents if one.transport is not agent.transport]
            self.run(self.kill(agent.transport))

    async def kill(self, transport: object) -> None:
        assert isinstance(transport, MemoryTransport)
        self.network.kill(transport)

    @rule(lookup=lookups, stopped=st.booleans())
    def stop_lookup(self, lookup: LookupService, *, stopped: bool) -> None:
        self.run(self.silence(lookup._transport, stopped))

    @rule(agent=agents, stopped=st.booleans())
    def stop_agent(self, agent: Agent, *, stopped: bool) -> None:
        if agent in self.living_agents:
            self.run(self.silence(agent.transport, stopped))

    async def silence(self, transport: object, stopped: bool) -> None:  # noqa: FBT001
        assert isinstance(transport, MemoryTransport)
        (self.network.freeze if stopped else self.network.thaw)(transport)

    @rule(agent=agents, lookup=lookups)
    def cut_them(self, agent: Agent, lookup: LookupService) -> None:
        self.run(self.cut(agent.transport, lookup._transport))

    @rule(lookup=lookups)
    def cut_onlooker(self, lookup: LookupService) -> None:
        self.run(self.cut(self.onlooker_transport, lookup._transport))

    async def cut(self, one: object, other: object) -> None:
        assert isinstance(one, MemoryTransport)
        assert isinstance(other, MemoryTransport)
        self.network.cut(one, other)

    @rule(seconds=st.sampled_from([0.0, 0.01, 1.0, 2.5, 12.0, 70.0]))
    def wait(self, seconds: float) -> None:
        self.run(asyncio.sleep(seconds))

    # -- the laws ---------------------------------------------------------------------------------

    @rule()
    def settle(self) -> None:
        """When all faults are over, all services and clients have the true list, and no other entry."""

        async def heal() -> None:
            members = list(self.network.members)
            for member in members:
                self.network.thaw(member)
                for other in members:
                    if member is not other:
                        self.network.heal(member, other)
            await asyncio.sleep(SETTLED)

        self.run(heal())
        truth = {agent.listing.name: agent.listing.doc for agent in self.living_agents if agent.free}
        for lookup in self.living_lookups:
            found = lookup.table.find(Template(), self.loop.time())
            assert {listing.name: listing.doc for listing, _ in found} == truth, lookup.address.name
        assert self.onlooker.stale == (not self.living_lookups)
        seen = {listing.name: listing.doc for listing in self.onlooker.listings}
        if self.living_lookups:
            assert seen == truth
        else:
            assert seen.keys() <= {agent.listing.name for agent in self.living_agents}, "the dead are gone"

    @invariant()
    def each_agent_is_seen_once(self) -> None:
        names = [listing.name for listing in self.onlooker.listings]
        assert len(names) == len(set(names))


LookupMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
TestLookup = LookupMachine.TestCase
