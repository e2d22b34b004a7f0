"""A whole realm in the World: lookups, hosts, proxies with their controllers, and operators."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any

from robotree.protocol.messages import Verb
from robotree.proxy.agent import running_proxy
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Motion, Request
from robotree.proxy.robot_proxy import RobotProxy
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.author.command import command
from robotree.vr.base.units import Unit
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.running.process import Process
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.world import Main, SimulatedProcess, World
from tests.world.controller import FIRST_EPOCH, CartController

SOURCE = """
from robotree.vr import Child, VirtualRobot, command

class Pair(VirtualRobot):
    \"\"\"Drives two carts, one after the other.\"\"\"
    left = Child("CartProxy")
    right = Child("CartProxy")

    @command
    def drive(self, ticket: float, seconds: float) -> float:
        self.left.drive(ticket=10 * ticket + 1, seconds=seconds)
        self.sleep(0.1)
        self.right.drive(ticket=10 * ticket + 2, seconds=seconds)
        return ticket

class Train(VirtualRobot):
    \"\"\"Drives a pair of carts twice.\"\"\"
    pair = Child("Pair")

    @command
    def drive(self, ticket: float, seconds: float) -> float:
        for turn in (1, 2):
            self.pair.drive(ticket=10 * ticket + turn, seconds=seconds)
        return ticket
"""
WITHOUT_CLAIMS = 3
"""Number of the cart whose controller knows no claims."""
LIMITS: Limits = {
    "seconds": Span(0.0, 60.0, "s"),
    "ticket": Span(0.0, 1e7, ""),
    "lease": Span(0.0, 1e7, ""),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive(Motion):
    """Drive for a while [s]; the ticket distinguishes this drive from all others."""

    seconds: float
    ticket: float
    lease: float

    def request(self) -> Request:
        return Request(Verb.MOVE, (self.seconds, self.ticket, self.lease))


class CartProxy(RobotProxy):
    """A cart."""

    limits = LIMITS
    on_call: Callable[[CartProxy], None] = staticmethod(lambda _: None)
    """Called with each drive that begins to be carried out; set by the judge."""

    @command
    def drive(self, ticket: float, seconds: Annotated[float, Unit("s"), "how long"]) -> float:
        """Drive for a while."""
        self.on_call(self)
        lease = float(self.context.epoch - FIRST_EPOCH)
        self.carry_out(Drive(seconds=seconds, ticket=ticket, lease=lease))
        return ticket


class Realm:
    """All processes of one World by name; those that died can be started again."""

    def __init__(self, world: World, *, lookups: int = 2, hosts: int = 3, carts: int = 4) -> None:
        self.world = world
        self.begun: list[tuple[float, str, int, int]] = []
        """Each drive that began: when, on which cart, its ticket, its epoch."""
        self.controllers = {
            f"cart-{number}": CartController(
                world, f"cart-{number}", tell=self._begin, claims=number != WITHOUT_CLAIMS
            )
            for number in range(1, carts + 1)
        }
        self.processes: dict[str, SimulatedProcess] = {}
        self.realm_clients: dict[str, RealmClient] = {}
        self.hosts: dict[str, Host] = {}
        self.carts: dict[str, RobotAgent] = {}
        self.on_call: Callable[[CartProxy], None] = lambda _: None
        self._chance = random.Random(f"{world.seed} realm")
        for number in range(1, lookups + 1):
            self.start(f"lookup-{number}")
        for number in range(1, hosts + 1):
            self.start(f"host-{number}")
        for name in self.controllers:
            self.start(name)
        self.start("operator-1")
        self.start("operator-2")

    def start(self, name: str) -> SimulatedProcess:
        """Start the process of that name, or start it again."""
        skew = self._chance.uniform(-2.0, 2.0)
        self.processes[name] = self.world.start(name, self._main_of(name), skew=skew)
        return self.processes[name]

    def _main_of(self, name: str) -> Main:
        roles: dict[str, Main] = {
            "lookup": self._lookup,
            "host": self._host,
            "cart": self._cart,
            "operator": self._operator,
        }
        return roles[name.partition("-")[0]]

    def agents(self) -> dict[str, RobotAgent]:
        """Return the agents of all robots whose process runs, by name."""
        found = {name: agent for name, agent in self.carts.items() if self.processes[name].alive}
        for name, host in self.hosts.items():
            if self.processes[name].alive:
                found.update(host.agents)
        return found

    async def create(self, realm_client: RealmClient, host: str, name: str, wanted: str) -> str:
        """Create a robot of `SOURCE` on a host."""
        address = await realm_client.directory.resolve(host, "host")
        made = await HostClient(realm_client._transport, address).create(
            Bundle(SOURCE, "/carts.py", wanted), name
        )
        return str(made.address)

    def _process(self, process: SimulatedProcess) -> Process:
        return Process(process.runner, core=self.world.core)

    # -- what the processes do --------------------------------------------------------------------

    async def _lookup(self, process: SimulatedProcess) -> None:
        await LookupService(process.transport, process.name).start()
        await asyncio.Event().wait()

    async def _host(self, process: SimulatedProcess) -> None:
        transport = process.transport
        home = self._process(process)
        host = Host(transport, process.name, registrar=Registrar(transport), process=home, limit=inf)
        self.hosts[process.name] = host
        await host.start()
        await asyncio.Event().wait()

    async def _cart(self, process: SimulatedProcess) -> None:
        name = process.name
        robot = CartProxy(
            name,
            "tcp:127.0.0.1:5760",
            dial=self.controllers[name].dialler(process),
            chance=random.Random(f"{self.world.seed} {name}"),
            runner=process.runner,
        )
        robot.on_call = self.on_call
        self.carts.pop(name, None)
        async with running_proxy(robot, process.transport, process=self._process(process)) as agent:
            self.carts[name] = agent
            await agent.closed.wait()

    async def _operator(self, process: SimulatedProcess) -> None:
        realm_client = self.realm_clients[process.name] = RealmClient(process.transport)
        await realm_client.start()
        await realm_client.watch_state(None)  # as the screen does
        await asyncio.Event().wait()

    def _begin(self, cart: str, ticket: int, epoch: int) -> None:
        self.begun.append((self.world.runner.now(), cart, ticket, epoch))
        self.world.note(cart, "drives", (ticket, epoch))


def leaf_tickets(name: str, ticket: int) -> list[int]:
    """Return the tickets that the drive of a robot leads to at the controllers."""
    if name == "train":
        return [leaf for turn in (1, 2) for leaf in leaf_tickets("pair", 10 * ticket + turn)]
    return [10 * ticket + 1, 10 * ticket + 2] if name in {"pair", "spare"} else [ticket]


def lease_of(agent: RobotAgent) -> Any:
    """Return the lease in force on a robot; None: it is free."""
    return agent.runtime.core.state.lease.current
