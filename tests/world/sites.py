"""Stories of sites: gateways and cut lines in virtual time, by the same code that runs between machines.

Three sites have a lookup, robots, an operator and a gateway each, and clocks of their own. Robot `team` of
lab commands `rover` of hall over the line. For 40 s lines are cut and lose, gateways and robots die or stand
still, operators call, stop and resume, and sites that are cut off enslave what they can. Then all is healed.

The laws: a robot obeys one commander at a time, and no epoch that is older than one it obeyed; what was asked
begins within its time or never; what was confirmed as stopped begins nothing until somebody resumes it; a
robot's trees on one machine are never disturbed by a line; and when all is healed everybody sees everybody,
with its site, lookups agree, and the bonds hold.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Generator
from functools import cache, partial
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import VrError
from robotree.vr.base.places import Places
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.running.process import Process
from robotree.vr.sites.frames import SiteStopped
from robotree.vr.sites.gateway import Gateway
from robotree.vr.sites.invitations import read_token, request_to_join, token_of
from robotree.vr.sites.keys import RealmKeys, create, join
from robotree.vr.sites.stopping import came_of
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.supervision.stop import StopScope
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.world import SimulatedProcess, World
from tests.world.realm import be_lookup, be_operator
from tests.world.story import Laws
from tests.world.wide import MemoryGround, WideArea, WidePipe

SITES = ("lab", "hall", "yard")
LENGTH, CALM = 70.0, 42.0
"""[s] of a story, and from when on nothing goes wrong any more."""
WHOLE = 20.0
"""[s] of calm in which everything is whole again: a site is gone after 6 s, and greeted each 5 s."""
FRESH = 3.0
"""[s] in which what was asked begins."""
SLACK = 0.4
"""[s] for the way, which counts too."""
WALL = 1_800_000_000.0
WORK = 0.4
"""[s] that a command takes."""


class Rover(Robot):
    """Works for a while, and tells the judge."""

    judge: Judge

    @command
    def work(self, ticket: float) -> float:
        self.judge.begin(self, ticket)
        self.sleep(WORK)
        return ticket


class Team(VirtualRobot):
    """Commands a rover, wherever it is."""

    rover = Child("Rover")

    @command
    def work(self, ticket: float) -> float:
        return self.rover.work(ticket=ticket)


class Judge(Laws):
    """Watches the robots, and reports each broken law."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.asked: dict[float, float] = {}
        """When each ticket was asked for [s]."""
        self.tickets = set[float]()
        self.stopped: dict[str, float] = {}
        """Robots whose stop was confirmed, by site and name, that nobody has been asked to resume since."""
        self._epochs: dict[object, int] = {}
        self.begun = 0
        self.agents: dict[str, RobotAgent] = {}
        """Robots of processes that live, by site and name."""

    def begin(self, rover: Rover, ticket: float) -> None:
        """A robot begins a command."""
        now, context = self.world.runner.now(), rover.context
        self.begun += 1
        name = rover.attributes["site"] + ":" + rover.name
        agent = self.agents[name]
        lease = agent.runtime.core.state.lease.current
        if lease is not None and context.caller != lease.parent.name:
            self.complain(f"{name} obeys {context.caller} while {lease.parent.name} commands it")
        if lease is not None and context.epoch != lease.epoch:
            self.complain(f"{name} obeys epoch {context.epoch}, and {lease.epoch} is in force")
        if context.epoch < self._epochs.get(agent.address, 0):
            self.complain(f"{name} obeyed epoch {context.epoch} after {self._epochs[agent.address]}")
        self._epochs[agent.address] = context.epoch
        if ticket in self.tickets:
            self.complain(f"ticket {ticket:g} was begun twice")
        self.tickets.add(ticket)
        # a call of a parent has a time of its own: it is asked by the parent when that begins
        hops = 2 if lease is not None else 1
        if now > self.asked[ticket] + hops * (FRESH + SLACK):
            self.complain(f"ticket {ticket:g} began {now - self.asked[ticket]:.1f} s after it was asked for")
        if name in self.stopped:
            self.complain(f"{name} began a command after its stop was confirmed")


class SiteProcess(SimulatedProcess):
    """A process on the machine of a site: `lab.host`."""

    world: SitesWorld

    @property
    def site(self) -> str:
        return self.name.partition(".")[0]

    @property
    def network(self) -> MemoryNetwork:
        return self.world.networks[self.site]

    def _boot(self) -> None:
        self.transport: MemoryTransport = self.network.join(self.name, loop=self.loop)

    def _stand_still(self) -> None:
        self.network.pause(self.transport)

    def _go_on(self) -> None:
        self.network.resume(self.transport)

    def _let_go(self) -> None:
        if not self.transport.closed:
            self.network.kill(self.transport)


class SitesWorld(World):
    """A World with a network for each site, and lines between them."""

    process_class = SiteProcess

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.networks = {
            site: MemoryNetwork(
                delay=0.001,
                agenda=self.runner,
                chance=random.Random(f"{seed} network of {site}").random,
            )
            for site in SITES
        }
        for network in self.networks.values():
            network.on_message = self._message
        self.area = WideArea(self.runner, random.Random(f"{seed} lines").random)


@cache
def _made() -> Path:
    """Make a realm with three sites, once: the folder of each has its keys."""
    folder = Path(tempfile.mkdtemp(prefix="rt-keys-"))
    keys = [create(folder / "lab" / "keys", "plant", "lab", (), now=WALL)]
    for name in SITES[1:]:
        invitation = read_token(token_of(keys[0].invite(name, "site", now=WALL)), WALL)
        key = Ed25519PrivateKey.generate()
        certificate = keys[0].admit(request_to_join(invitation, key), WALL)
        keys.append(join(folder / name / "keys", invitation, key, certificate, now=WALL))
    return folder


@contextlib.contextmanager
def realm_keys() -> Generator[Path]:
    """Have folders with keys for all sites, as they were when the realm was made."""
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        for site in SITES:
            shutil.copytree(_made() / site, Path(folder) / site)
        yield Path(folder)


class Realm:
    """All processes of a story."""

    judge_class: type[Judge] = Judge
    rover_class: type[Rover] = Rover

    def __init__(self, world: SitesWorld, folder: Path, *, offset: float = 1000.0) -> None:
        self.world, self.folder, self.judge = world, folder, self.judge_class(world)
        self.offsets = {site: number * offset for number, site in enumerate(SITES)}
        self.processes: dict[str, SiteProcess] = {}
        self.gateways: dict[str, Gateway] = {}
        self.operators: dict[str, RealmClient] = {}
        self.agents = self.judge.agents
        for site in SITES:
            for role in ("gateway", "lookup", "rover", "team", "operator"):
                self.start(f"{site}.{role}")

    def start(self, name: str) -> None:
        """Start a process, or start it again."""
        site, _, role = name.partition(".")
        mains: dict[str, Callable[[SimulatedProcess], Any]] = {
            "gateway": self._gateway,
            "lookup": be_lookup,
            "rover": partial(self._robot, kind=self.rover_class),
            "team": partial(self._robot, kind=Team),
            "operator": self._operator,
        }
        started = self.world.start(name, mains[role], offset=self.offsets[site])
        assert isinstance(started, SiteProcess)
        self.processes[name] = started

    async def _gateway(self, process: SimulatedProcess) -> None:
        site = process.name.partition(".")[0]
        transport, world = process.transport, self.world
        client = RealmClient(transport, "plant")
        chance = random.Random(f"{world.seed} {site} {process.started}").randbytes

        async def stop_here(order: str, _reason: str) -> SiteStopped:
            try:
                return came_of(await client.stop(None, order=order, scope=StopScope(local=gateway.is_local)))
            except VrError as error:
                return came_of(error)

        gateway = Gateway(
            transport,
            WidePipe(world.area, site),
            RealmKeys(self.folder / site / "keys"),
            ground=MemoryGround(transport),
            stop_here=stop_here,
            wall=lambda: WALL + world.runner.now(),
            chance=chance,
        )
        await gateway.open()
        self.gateways[site] = gateway
        await asyncio.Event().wait()

    async def _robot(self, process: SimulatedProcess, kind: type[Robot]) -> None:
        site, _, name = process.name.partition(".")
        robot = kind(name)
        robot.attributes["site"] = site
        if isinstance(robot, Rover):
            robot.judge = self.judge
        home = Process(process.runner, core=self.world.core)
        agent = RobotAgent(robot, process.transport, registrar=Registrar(process.transport), process=home)
        self.agents[f"{site}:{name}"] = agent
        await agent.start()
        await asyncio.Event().wait()

    async def _operator(self, process: SimulatedProcess) -> None:
        await be_operator(process, self.operators, process.name.partition(".")[0], realm="plant")


class Story:
    """What happens."""

    faults: tuple[str, ...] = (
        *("cut", "cut", "lossy", "slow", "hub", "gateway"),
        *("pause", "robot", "operator"),
    )
    terms: tuple[float, ...] = (0.5, 1.5, 3.0, 6.5, 9.0)
    """[s] that a fault lasts."""

    def __init__(self, realm: Realm) -> None:
        self.realm, self.world, self.judge = realm, realm.world, realm.judge
        self.chance = random.Random(f"{realm.world.seed} story")
        self._ticket = 0.0

    def plan(self) -> None:
        """Enter what happens, and when."""
        at, chance = self._at, self.chance
        at(3.0, lambda: self.ask("lab", lambda client: client.enslave("lab:team", "rover", "hall:rover")))
        at(3.2, lambda: self.ask("yard", lambda client: client.enslave("yard:team", "rover", "yard:rover")))
        for number in range(14):
            at(chance.uniform(6.0, CALM - 2), self.fault)
            at(chance.uniform(5.0, CALM), partial(self.call, chance.choice(SITES)))
            at(chance.uniform(5.0, CALM), partial(self.call, "yard", "yard:team"))
            if number % 3 == 0:
                at(chance.uniform(6.0, CALM), partial(self.stop, chance.choice(SITES)))
                at(chance.uniform(6.0, CALM), partial(self.take_over, chance.choice(SITES)))
        at(CALM, self.heal)
        for late in (8.0, WHOLE - 4):
            at(CALM + late, partial(self.resume, "lab"))
            at(CALM + late + 1, self.bind_again)
        at(CALM + WHOLE, self.examine)
        at(CALM + WHOLE + 1, partial(self.call, "lab", "lab:team", last=True))

    def new_ticket(self) -> float:
        """Return the next ticket."""
        self._ticket += 1
        return self._ticket

    def _at(self, when: float, action: Callable[[], None]) -> None:
        self.world.runner.at(when, action)

    # -- what people do ---------------------------------------------------------------------------

    def ask(self, site: str, question: Callable[[RealmClient], Awaitable[Any]], what: str = "asks") -> None:
        """Have the operator of a site ask something."""
        client, process = self.realm.operators.get(site), self.realm.processes[f"{site}.operator"]
        if client is not None:
            process.do(lambda: question(client), what)

    def call(self, site: str, robot: str = "", *, last: bool = False) -> None:
        """Have a robot work."""
        ticket = self.new_ticket()
        name = robot or self.chance.choice(["lab:team", "hall:rover", "lab:rover", "yard:rover", "hall:team"])
        self.judge.asked[ticket] = self.world.runner.now()

        async def call(client: RealmClient) -> None:
            try:
                await client.call(name, "work", {"ticket": ticket}, deadline=10.0)
            except VrError as error:
                if last:
                    self.judge.complain(f"the last call through the tree failed: {error}")
                raise
            if ticket not in self.judge.tickets:
                self.judge.complain(f"ticket {ticket:g} succeeded and was never begun")

        self.ask(site, call, f"calls {name}")

    def stop(self, site: str) -> None:
        """Stop everything, from one site; what is confirmed is stopped."""
        others = [one for one in SITES if one != site]
        robots = {
            f"{one}:{role}": process
            for one in SITES
            for role in ("rover", "team")
            # one that has just come may come after the order to its site
            if (process := self.realm.processes[f"{one}.{role}"]).alive
            and process.started < self.world.runner.now() - FRESH
        }

        async def stop(client: RealmClient) -> None:
            begin, resumes = self.world.runner.now(), self._resumes
            try:
                told = list(await client.stop(None, scope=StopScope(others)))
                whole = True
            except VrError as error:
                told, whole = list(error.data.get("told", ())), False
            names = {name if ":" in name else f"{site}:{name}" for name in told}
            living = {name for name, process in robots.items() if process.alive}
            if whole and (missed := living - names):
                self.judge.complain(f"a stop claims to be whole without {sorted(missed)}")
            if self._resumes == resumes:
                for name in names & living:
                    self.judge.stopped[name] = begin
            self._at(self.world.runner.now() + 2.0, partial(self.resume, site))

        self.ask(site, stop, "stops")

    _resumes = 0

    def resume(self, site: str) -> None:
        """Resume everything."""
        self._resumes += 1
        self.judge.stopped.clear()
        self.ask(site, lambda client: client.resume(None), "resumes")

    def take_over(self, site: str) -> None:
        """The team of a site enslaves a rover of any site, if it can."""
        rover = f"{self.chance.choice(SITES)}:rover"

        async def take(client: RealmClient) -> None:
            with contextlib.suppress(VrError):
                await client.release(f"{site}:team", "rover")
            await client.enslave(f"{site}:team", "rover", rover)

        self.ask(site, take, f"enslaves {rover}")

    # -- what goes wrong --------------------------------------------------------------------------

    def fault(self) -> None:
        """Let something go wrong, for a while."""
        chance, area = self.chance, self.world.area
        site, seconds, kind = chance.choice(SITES), chance.choice(self.terms), chance.choice(self.faults)
        line, now = area.line(site), self.world.runner.now()
        self.world.note(site, kind, seconds)
        match kind:
            case "cut":
                line.up = False
                self._at(now + seconds, partial(setattr, line, "up", True))
            case "lossy":
                line.loss, line.duplication, line.jitter = 0.2, 0.2, 0.05
                self._at(now + seconds, partial(self._calm, site))
            case "slow":
                line.delay = 0.3
                self._at(now + seconds, partial(self._calm, site))
            case "hub":
                area.kill_hub()
                self._at(now + seconds, area.start_hub)
            case "pause":
                process = self.realm.processes[f"{site}.{chance.choice(['gateway', 'rover', 'team'])}"]
                process.pause()
                self._at(now + min(seconds, 3.0), process.resume)
            case _:
                role = {"robot": chance.choice(["rover", "team"])}.get(kind, kind)
                self._kill(f"{site}.{role}", seconds)

    def _calm(self, site: str) -> None:
        line = self.world.area.line(site)
        line.delay, line.jitter, line.loss, line.duplication = 0.02, 0.0, 0.0, 0.0

    def _kill(self, name: str, seconds: float) -> None:
        site, _, role = name.partition(".")
        self.realm.processes[name].kill()
        if role in {"rover", "team"}:
            self.judge.stopped.pop(f"{site}:{role}", None)  # one that is made anew was never stopped
        if role == "gateway":
            for pipe in [one for one in self.world.area.pipes if one.site == site]:
                pipe.close()
        self._at(self.world.runner.now() + min(seconds, 3.0), partial(self._again, name))

    def _again(self, name: str) -> None:
        if not self.realm.processes[name].alive:
            self.realm.start(name)

    def heal(self) -> None:
        """Nothing goes wrong any more."""
        area = self.world.area
        area.start_hub()
        for site in SITES:
            area.line(site).up = True
            self._calm(site)
        for name, process in self.realm.processes.items():
            process.resume()
            self._again(name)

    def bind_again(self) -> None:
        """Have lab's team command hall's rover again, whoever has it now."""

        async def bind(client: RealmClient) -> None:
            for site in SITES:
                with contextlib.suppress(VrError):
                    await client.release(f"{site}:team", "rover")
            await client.enslave("lab:team", "rover", "hall:rover")

        self.ask("lab", bind, "binds again")

    # -- the end ----------------------------------------------------------------------------------

    def examine(self) -> None:
        """Everybody sees everybody, with its site, and lookups agree."""
        living = {agent.address.key: name for name, agent in self.realm.agents.items()}
        lists: dict[str, set[str]] = {}
        for site, client in self.realm.operators.items():
            presence = self.realm.processes[f"{site}.operator"].transport.presence
            seen = set(presence.keys("robot/*/*"))
            if seen != living.keys():
                lacks, ghosts = sorted(living.keys() - seen), sorted(seen - living.keys())
                self.judge.complain(f"{site} lacks {lacks} and sees {ghosts}")
            places = Places(presence)
            for key in seen & living.keys():
                there = places.site_of(key) or site
                if there != living[key].partition(":")[0]:
                    self.judge.complain(f"{site} thinks that {living[key]} is at {there}")
            if away := [one for one in places.sites() if places.silent(one)]:
                self.judge.complain(f"{site} does not hear {away}")
            lists[site] = {one.address.key for one in client.directory.listings}
        if len({frozenset(one) for one in lists.values()}) != 1:
            self.judge.complain(f"lists differ: {lists}")


def play(
    seed: int,
    realm_class: type[Realm] = Realm,
    story_class: type[Story] = Story,
    length: float = LENGTH,
) -> tuple[str, Any]:
    """Play the story of a seed; returns the digest of its trace, and the judge."""
    with realm_keys() as folder, SitesWorld(seed) as world:
        realm = realm_class(world, folder)
        story_class(realm).plan()
        world.run(length)
        realm.judge.broken += world.complaints
        return world.digest, realm.judge
