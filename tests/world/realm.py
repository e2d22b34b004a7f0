"""A whole realm in the World: lookups, hosts, proxies with their controllers, and operators."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, inf
from typing import Annotated, Any

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkBroken, LinkError, LinkRefused
from robotree.protocol.links.link import Accept, Link
from robotree.protocol.messages import MavType, Verb
from robotree.protocol.services.fence import Fence
from robotree.proxy.agent import running_proxy
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Motion, Request
from robotree.proxy.robot_proxy import RobotProxy
from robotree.sim.controller.controller import Controller
from robotree.sim.firmware import COMPONENT, Firmware
from robotree.sim.firmware.device import Device, Progress, Start, ended
from robotree.sim.firmware.telemetry import Identity
from robotree.testing.simulated import Cable, CableEnd
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
from robotree.vr.world.virtual_runner import BEGINNING, VirtualRunner
from robotree.vr.world.world import Main, SimulatedProcess, World

FIRST_EPOCH = int(BEGINNING) - 1000
"""Below all epochs of a World; its clocks are not skewed by more."""
IDLE = 0.25
"""[s] An idle controller looks at its clock at a multiple of this, and only if something is due."""
MOVING = 0.1
"""[s] between two looks while something moves."""
BATCH = 0.005
"""[s] from the arrival of a frame to the batch that hears it."""

OnBegin = Callable[[str, int, int], None]
"""Told of a drive that begins: controller, ticket, epoch."""


class Cart(Device):
    """A device that drives for a while.

    MOVE's arguments are how long [s], a ticket that tells the drive from all others, and the epoch of the
    lease under which it was asked for, above `FIRST_EPOCH` (a float of the wire is exact up to 2**24).
    """

    def __init__(self, now: Callable[[], float], on_begin: Callable[[int, int], None]) -> None:
        self._now, self._on_begin = now, on_begin
        super().__init__(None, (), {Verb.MOVE: self._move, Verb.HOLD: lambda _: self.hold})
        self._began = self._ends = 0.0
        self.ticket: int | None = None
        """Of the drive under way."""

    @property
    def moving(self) -> bool:
        return self.ticket is not None and self._now() < self._ends

    def progress(self) -> Progress:
        if self.ticket is None:
            return ended()
        now = self._now()
        if now >= self._ends:
            return Progress(1.0, done=True)
        return Progress((now - self._began) / (self._ends - self._began))

    def hold(self) -> None:
        self.ticket = None

    def control(self, dt: float) -> None:
        """The cart needs no control."""

    def _move(self, args: tuple[float, ...]) -> Start:
        def begin() -> None:
            self._began = self._now()
            self._ends = self._began + args[0]
            self.ticket = round(args[1])
            self._on_begin(self.ticket, round(args[2]) + FIRST_EPOCH)

        return begin


class Cell:
    """A world without physics: its time is virtual time since it was switched on."""

    def __init__(self, runner: VirtualRunner, device: Cart) -> None:
        self.device = device
        self._runner, self._on = runner, runner.now()

    @property
    def time_ms(self) -> int:
        return round(1000 * (self._runner.now() - self._on))

    def look(self, due: float) -> float:
        """Return when an idle controller looks [s of the world] for which something is due [s of its own]."""
        return self._on + ceil(max(due, self.time_ms / 1000 + 0.001) / IDLE) * IDLE

    def advance(self) -> None:
        """Nothing moves by itself."""


class CartController:
    """The controller of one cart: the real firmware, in virtual time. Its power and its cables can fail."""

    def __init__(self, world: World, name: str, *, tell: OnBegin, claims: bool = True) -> None:
        """Switch it on.

        Args:
            world: whose time it lives in.
            name: also its address.
            tell: what begins to move: controller, ticket, epoch.
            claims: whether it knows claims; one that does not says no number of its life, and only its fence
                refuses goals of an old lease.
        """
        self.world, self.name, self._tell, self._claims = world, name, tell, claims
        self.delay, self.jitter = 0.002, 0.0
        self.disturbed = 0.0
        """[s] When something last happened to it or its cables."""
        self.slowest = 0.0
        """[s] The longest way that a frame may have had."""
        self.reachable = True
        self.fence = Fence()
        self._life = 0
        self._cables: list[Cable] = []
        self._due = 0.0
        self._switch_on()

    # -- faults --------------------------------------------------------------------------------

    def cut(self) -> None:
        """Break all cables; new ones cannot be had until `mend`."""
        self.world.note(self.name, "cut")
        self.disturbed = self.world.runner.now()
        self.reachable = False
        cables, self._cables = self._cables, []
        for cable in cables:
            cable.end(LinkBroken(self.name, "the cable was cut"))

    def mend(self) -> None:
        """Let new cables be laid."""
        self.reachable = True

    def slow_down(self, delay: float, jitter: float) -> None:
        """Let frames take long [s], and up to `jitter` longer by chance."""
        self.delay, self.jitter = delay, jitter
        self.disturbed = self.world.runner.now()
        self.slowest = max(self.slowest, delay + jitter)

    def calm(self) -> None:
        """Let frames arrive quickly again."""
        self.delay, self.jitter = 0.002, 0.0
        self.disturbed = self.world.runner.now()

    def power_cycle(self) -> None:
        """Lose everything but the fence, and begin a new life."""
        self.world.note(self.name, "power cycle")
        self.disturbed = self.world.runner.now()
        cables, self._cables = self._cables, []
        for cable in cables:
            cable.end(LinkBroken(self.name, "the controller has lost its power"))
        self._switch_on()

    # -- for proxies ------------------------------------------------------------------------------

    def dialler(self, process: SimulatedProcess) -> Callable[[str, Accept], Any]:
        """Return how a process opens a link to this controller."""

        async def dial(url: str, accept: Accept) -> Link:
            del url
            if not self.reachable:
                raise LinkRefused(self.name, "no route to it")
            cable = Cable(self.world, self, process)
            self._cables.append(cable)
            self._accept(cable.far)
            cable.near.handler = accept(cable.near)
            return cable.near

        return dial

    # -- inside -----------------------------------------------------------------------------------

    def _switch_on(self) -> None:
        runner = self.world.runner
        self._life += 1
        self.device = Cart(runner.now, lambda ticket, epoch: self._tell(self.name, ticket, epoch))
        self.firmware = Firmware(
            self.device,
            (),
            system=1,
            mav_type=MavType.GROUND_ROVER,
            identity=Identity(life=self._life if self._claims else 0),
            fence=self.fence,
        )
        self._endpoints: list[Endpoint] = []
        self._cell: Any = Cell(runner, self.device)
        self._controller = Controller(self._cell, self.firmware, {})
        self._advance_by(runner.now())

    def _accept(self, link: CableEnd) -> None:
        controller, endpoints = self._controller, self._endpoints

        def closed(_: LinkError) -> None:
            endpoints.remove(endpoint)
            controller.leave(endpoint)
            self._advance_by(self.world.runner.now())

        def hear(frame: Any) -> None:
            controller.post(frame, endpoint)
            self._advance_by(self.world.runner.now() + BATCH)

        endpoint = Endpoint(link, system=1, component=COMPONENT, on_frame=hear, on_closed=closed)
        endpoints.append(endpoint)
        link.handler = endpoint
        controller.greet(endpoint)
        self._advance_by(self.world.runner.now() + BATCH)

    def _advance_by(self, when: float) -> None:
        """Let it look at its clock at a moment at the latest."""
        now = self.world.runner.now()
        if now < self._due <= when:
            return
        self._due = when
        life = self._life

        def advance() -> None:
            if life == self._life and self._due == when:
                self._advance()

        self.world.runner.at(when, advance)

    def _advance(self) -> None:
        self._due = 0.0
        for outgoing in self._controller.advance():
            for endpoint in list(self._endpoints):
                if outgoing.via is None or outgoing.via is endpoint:
                    endpoint.send(outgoing.message, telemetry=outgoing.telemetry, instance=outgoing.instance)
        now, due = self.world.runner.now(), self.firmware.due
        if self._controller.waiting:
            self._advance_by(now + BATCH)
        elif due == -inf:
            self._advance_by(now + MOVING)
        elif due < inf:
            self._advance_by(self._cell.look(due))


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


async def be_lookup(process: SimulatedProcess) -> None:
    """Be a lookup service, for ever."""
    await LookupService(process.transport, process.name.replace(".", "-")).start()
    await asyncio.Event().wait()


async def be_operator(
    process: SimulatedProcess,
    clients: dict[str, RealmClient],
    name: str = "",
    *,
    realm: str = "",
    watches: bool = True,
) -> None:
    """Be the program of an operator, for ever.

    Args:
        process: in which it runs.
        clients: gets its client.
        name: under which it gets it; empty: that of the process.
        realm: what the realm is called.
        watches: whether it watches the states of all robots, as the screen does.
    """
    client = clients[name or process.name] = RealmClient(process.transport, realm)
    await client.start()
    if watches:
        await client.watch_state(None)
    await asyncio.Event().wait()


def host_in(process: SimulatedProcess, home: Process[Any]) -> Host:
    """Return a host that keeps nothing."""
    transport = process.transport
    return Host(transport, process.name, registrar=Registrar(transport), process=home, limit=inf)


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
            "lookup": be_lookup,
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

    async def _host(self, process: SimulatedProcess) -> None:
        host = self.hosts[process.name] = host_in(process, self._process(process))
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
        await be_operator(process, self.realm_clients)

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
