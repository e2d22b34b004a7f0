"""Stories from a seed: what operators do and what goes wrong, and a judge that checks the laws.

A story lasts 60 s. In the first 4 s the realm is built: `train` commands `pair`, which commands `cart-1` and
`cart-2`; the other carts are free. Until 40 s operators call, cancel, stop, release and bind anew, while
processes and connections fail and carts move from `pair` to `spare` and back. Then everything is healed, and
the realm must be whole again.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from robotree.protocol.messages import ModeKind
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import VrError
from robotree.vr.exchange.asking import fresh_key
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.realm_client import CALLER, RealmClient
from robotree.vr.world.world import SimulatedProcess, World
from tests.world.machine import tell
from tests.world.realm import CartController, CartProxy, Realm, leaf_tickets, lease_of

LENGTH = 60.0
"""[s] of a story."""
CALM = 40.0
"""[s] from which on nothing goes wrong any more."""
CROSSING = 33.0
"""[s] when a stop and a release cross each other on their ways."""
PROBE = 52.0
"""[s] when a call through the whole tree must succeed."""
LATE = 0.5
"""[s] that a drive may begin or go on after the deadline of its call, besides the way of its frames."""
LONGEST_SILENCE = 2.5
"""[s] that a cart may drive on after its proxy fell silent: the controller's patience, and its periods."""
RESTOPPED = 6.0
"""[s] after an fault within which a proxy has stopped its controller again."""
ORPHANED = 6.0
"""[s] that a drive may go on after the program that asked for it is gone: it is missed, then leases end."""
WORST_JITTER = 0.3
"""[s] that bad weather delays a message at most."""
HOPS = 3
"""Messages from an operator down to a cart, on each of which the time that is left begins anew."""
LOOK = 0.1
"""[s] between two looks of the judge."""
Work = Callable[[RealmClient], Awaitable[object]]
BONDS = {("pair", "left"): "cart-1", ("pair", "right"): "cart-2", ("train", "pair"): "pair"}
"""Which parent commands which child, at first and at the end."""
ROBOTS = (("pair", "host-1", "Pair"), ("train", "host-2", "Train"), ("spare", "host-3", "Pair"))


@dataclass
class Outcome:
    """What became of one seed."""

    seed: int
    digest: str
    broken: list[str]
    """Laws that were broken; empty: none."""
    drives: int = 0
    calls: int = 0
    answered: int = 0
    faults: int = 0
    events: int = 0
    trace: list[object] = field(default_factory=list)


SLOW_WAY = 3.0
"""[s] that a frame takes at worst."""
AGAIN = 2.0
"""[s] between two looks of the operator at what is missing or free."""


class Laws:
    """The laws of a story, as far as they were broken."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.broken: list[str] = []
        """The laws that were broken; empty: none."""

    def complain(self, law: str) -> None:
        """Note that a law is broken."""
        if law not in self.broken:
            self.broken.append(law)
            self.world.note("judge", law)


class Judge(Laws):
    """Watches the realm, and reports each broken law."""

    def __init__(self, realm: Realm) -> None:
        super().__init__(realm.world)
        self.realm = realm
        self.deadlines: dict[int, float] = {}
        """Until when each drive may go on, by its ticket."""
        self.stopped: dict[str, float] = {}
        """Carts whose stop was confirmed and that nobody has released since, and when."""
        self.cancelled: dict[int, float] = {}
        """Drives that were cancelled before they began, and when that was confirmed."""
        self._silent: dict[str, float] = {}
        """Since when nothing stands for a cart that drives, or only something that is paused."""
        self._paused: dict[str, float] = {}
        """When a proxy was paused last."""
        self._looks = self._seen = 0
        self._epochs: dict[str, int] = {}
        """The highest that each cart has obeyed."""
        self._fences: dict[str, int] = {}
        """The epoch of each controller's fence when it was looked at last."""
        self._tickets: set[int] = set()
        self._keys: set[tuple[object, str]] = set()
        realm.on_call = self.look_at_call

    def look(self) -> None:
        """Look at everything, and again soon."""
        self._look_at_drives()
        self._look_at_carts()
        self._looks += 1
        if self._looks % 5 == 0:
            self._look_at_bonds()
        self.world.runner.at(self.world.runner.now() + LOOK, self.look)

    def look_at_call(self, cart: CartProxy) -> None:
        """A cart begins to carry out a call: of its parent, if it has one."""
        agent, caller = self.realm.carts.get(cart.name), cart.context.caller
        lease = None if agent is None or agent.robot is not cart else lease_of(agent)
        commander = CALLER if lease is None else lease.parent.name
        if agent is not None and caller != commander:
            self.complain(f"{cart.name} obeys {caller} while {commander} commands it")
        if (cart, cart.context.key) in self._keys:
            self.complain(f"{cart.name} carries one call out twice")
        self._keys.add((cart, cart.context.key))

    def _look_at_drives(self) -> None:
        for when, cart, ticket, epoch in self.realm.begun[self._seen :]:
            if ticket in self._tickets:
                self.complain(f"drive {ticket} began twice")
            self._tickets.add(ticket)
            if epoch < self._epochs.get(cart, 0):
                self.complain(f"{cart} obeyed epoch {epoch} after {self._epochs[cart]}")
            self._epochs[cart] = max(epoch, self._epochs.get(cart, 0))
            if when > self.deadlines.get(ticket, 0.0) + self._allowance(cart):
                self.complain(f"drive {ticket} began after its deadline")
            if when > self.cancelled.get(ticket, when):
                self.complain(f"drive {ticket} began after its cancel was confirmed")
        self._seen = len(self.realm.begun)

    def _allowance(self, cart: str) -> float:
        """[s] that messages and frames may have been under way to this cart."""
        return LATE + self.realm.controllers[cart].slowest + HOPS * WORST_JITTER

    def _look_at_carts(self) -> None:
        now, silent = self.world.runner.now(), self._silent
        for name, controller in self.realm.controllers.items():
            epoch = controller.fence.epoch
            if epoch < self._fences.get(name, 0):
                self.complain(f"{name} went back to epoch {epoch}")
            self._fences[name] = epoch
            device, process = controller.device, self.realm.processes[name]
            if process.runner.halted:
                self._paused[name] = now
            if name in self.stopped:
                self._look_at_stop(name, controller, process)
            if device.ticket is None or not device.moving:
                silent.pop(name, None)
                continue
            if now > self.deadlines.get(device.ticket, 0.0) + self._allowance(name):
                self.complain(f"{name} still drives {device.ticket} after its deadline")
            if now > self.stopped.get(name, now) + LOOK:
                self.complain(f"{name} drives after its stop was confirmed")
            if process.alive and not process.runner.halted:
                silent.pop(name, None)
            elif now - silent.setdefault(name, now) > LONGEST_SILENCE + controller.slowest:
                self.complain(f"{name} drives on though its proxy is silent")

    def _look_at_stop(self, name: str, controller: CartController, process: SimulatedProcess) -> None:
        """What was confirmed to be stopped is stopped, some time after the last fault at the latest."""
        paused = self._paused.get(name, 0.0)
        quiet_since = max(self.stopped[name], controller.disturbed, process.started, paused)
        late = self.world.runner.now() > quiet_since + RESTOPPED
        if late and controller.firmware.mode != ModeKind.SAFE_STOP:
            self.complain(f"the controller of {name} is not in the stop that was confirmed")

    def _look_at_bonds(self) -> None:
        """A parent never believes in a lease that its child has ended by its clock."""
        agents = self.realm.agents()
        now = self.world.runner.now()
        by_key = {agent.address: agent for agent in agents.values()}
        for parent in agents.values():
            for slot in parent.runtime.core.state.slots.by_name.values():
                bond = slot.bond
                child = by_key.get(bond.child) if bond is not None else None
                if bond is None or child is None or bond.lease.expires <= now:
                    continue
                lease = lease_of(child)
                if (
                    lease is not None
                    and lease.epoch == bond.lease.epoch
                    and lease.expires < bond.lease.expires
                ):
                    self.complain(
                        f"{parent.robot.name} believes in a lease longer than {child.robot.name} grants"
                    )


class Eventful:
    """A story in which things go wrong, and are healed."""

    world: World
    _wounds: list[Callable[[], object]]
    """What heals what is broken at the moment."""

    def _after(self, seconds: float, action: Callable[..., object], *arguments: Any) -> None:
        self.world.runner.at(self.world.runner.now() + seconds, partial(action, *arguments))

    def _for(self, seconds: float, heal: Callable[[], object]) -> None:
        """Heal something after a while, and at the latest when all is healed."""
        done = False

        def once() -> None:
            nonlocal done
            if not done:
                done = True
                heal()

        self._wounds.append(once)
        self._after(seconds, once)

    def _heal(self) -> None:
        wounds, self._wounds = self._wounds, []
        for heal in wounds:
            heal()


class Deeds(Eventful):
    """A story in which operators do something, and other things happen."""

    processes: dict[str, SimulatedProcess]
    realm_clients: dict[str, RealmClient]
    """Of the operators whose programs are in the realm."""
    deeds = 0

    def _as_operator(self, work: Any, what: str, operator: str = "operator-1") -> None:
        """Have an operator do something: a coroutine."""
        process = self.processes[operator]
        if process.alive and operator in self.realm_clients:
            process.do(lambda: work, what)
        else:
            work.close()

    def _deed(self, what: str) -> None:
        self.deeds += 1
        self.world.note("story", what)

    def _end_operator(self, revive: Callable[[], object]) -> None:
        """Kill the second operator, who comes back soon."""
        self._deed("kill operator-2")
        self.processes["operator-2"].kill()
        self.realm_clients.pop("operator-2", None)
        self._after(0.5, revive)

    def _undone(self, open_calls: Mapping[str, float], agents: Mapping[str, RobotAgent]) -> Iterator[str]:
        """Yield what is wrong at the end: calls that never end, and what robots still have to do."""
        for label, latest in open_calls.items():
            if latest < self.world.runner.now():
                yield f"{label} never ends"
        for name, agent in agents.items():
            calls = agent.runtime.core.state.calls
            if calls.running or calls.waiting:
                yield f"{name} still has {calls.running} and {list(calls.waiting)}"
            if agent.runtime.runs:
                yield f"{name} still has runs {list(agent.runtime.runs)}"


class Judged:
    """A story with a judge of its own."""

    judge: Judge

    @property
    def broken(self) -> list[str]:
        """The laws that were broken; empty: none."""
        return self.judge.broken

    def complain(self, law: str) -> None:
        """Note that a law is broken."""
        self.judge.complain(law)


class Story(Judged, Eventful):
    """What happens to one realm."""

    def __init__(self, seed: int, world: World) -> None:
        self.world, self.realm = world, Realm(world)
        self.judge = Judge(self.realm)
        self.chance = random.Random(f"{seed} story")
        self.calls = self.answered = self.faults = self._releases = 0
        self._ticket = 1000  # so that no ticket of a drive is one of a call, which has ten times as many
        self.bonds = dict(BONDS)
        """Parents and their children."""
        self.whole = ""
        """The result of the last call, through the whole tree."""
        self._wounds = []

    def tell(self) -> None:
        """Let it all happen."""
        chance, at = self.chance, self.world.runner.at
        self.judge.look()
        self._as_operator(0.5, self._keep_whole)
        if chance.random() < 0.5:
            at(4.0, lambda: self._weather(CALM))
        for _ in range(20):
            at(chance.uniform(4.0, CALM), self._call)
        for _ in range(4):
            at(chance.uniform(4.0, CALM), self._call_and_cancel)
        for _ in range(2):
            at(chance.uniform(6.0, CALM - 6.0), self._stop)
        for _ in range(3):
            at(chance.uniform(5.0, CALM), self._bind_otherwise)
        for _ in range(chance.randrange(2, 9)):
            at(chance.uniform(4.0, CALM - 1.0), self._go_wrong)
        for when in (chance.uniform(5.0, 15.0), chance.uniform(15.0, 24.0), chance.uniform(24.0, 31.0)):
            at(when, chance.choice(self._scenes()))
        at(CROSSING, self._a_stop_crosses_a_release)
        at(CALM, self._heal)
        self._as_operator(PROBE - 3.0, lambda realm_client: realm_client.resume(None))
        at(PROBE, self._probe)
        self.world.run(LENGTH)
        if not self.whole:
            self.judge.complain("the realm is not whole again")
        for complaint in self.world.complaints:
            self.judge.complain(complaint)

    # -- operators --------------------------------------------------------------------------------

    def _as_operator(self, when: float, work: Work, what: str = "", *, operator: str = "operator-1") -> None:
        def begin() -> None:
            realm_client = self.realm.realm_clients.get(operator)
            if realm_client is not None:
                self.realm.processes[operator].do(lambda: work(realm_client), what)

        self.world.runner.at(when, begin)

    async def _keep_whole(self, realm_client: RealmClient) -> None:
        """Create what is missing and bind what is free, again and again."""
        while True:
            there = {address.name for address in realm_client.directory.present("robot")}
            for name, host, wanted in ROBOTS:
                if name not in there:
                    await self._try(self.realm.create(realm_client, host, name, wanted))
            for parent in ("spare", "pair", "train"):
                if parent in there:
                    await self._try(self._bind(realm_client, parent))
            await asyncio.sleep(AGAIN)

    async def _bind(self, realm_client: RealmClient, parent: str) -> None:
        for slot in (await realm_client.describe(parent)).slots:
            child, wanted = slot.child, self.bonds.get((parent, slot.name))
            if child is not None and child.name != wanted:
                await realm_client.release(parent, slot.name)
            elif child is None and wanted is not None:
                await self._try(realm_client.enslave(parent, slot.name, wanted))

    async def _try(self, work: Awaitable[object]) -> None:
        with contextlib.suppress(VrError):  # the next time perhaps
            await work

    def _call(self) -> None:
        chance = self.chance
        name = chance.choice(["train", "train", "train", "pair", "spare", "spare", "cart-3", "cart-1"])
        self._ticket += 1
        seconds = chance.uniform(0.2, 6.0) if chance.random() < 0.4 else chance.uniform(0.1, 1.0)
        operator = chance.choice(["operator-1", "operator-2"])
        self._drive(name, self._ticket, seconds, chance.uniform(0.5, 8.0), operator)
        if chance.random() < 0.25:
            when = self.world.runner.now() + chance.uniform(0.0, 3.0)
            self._as_operator(when, lambda realm_client: realm_client.cancel(name), f"cancel {name}")

    def _drive(
        self, name: str, ticket: int, seconds: float, deadline: float, operator: str = "operator-1"
    ) -> None:
        now, deadlines = self.world.runner.now(), self.judge.deadlines
        process = self.realm.processes[operator]
        if not process.alive or operator not in self.realm.realm_clients:
            return
        leaves = leaf_tickets(name, ticket)
        self.calls += 1

        def orphan() -> None:
            for leaf in leaves:
                deadlines[leaf] = min(deadlines.get(leaf, 0.0), self.world.runner.now() + ORPHANED)

        process.on_exit.append(orphan)

        async def call(realm_client: RealmClient) -> None:
            # a program that is paused at the moment asks when it goes on, and its deadline begins then
            deadlines.update(dict.fromkeys(leaves, self.world.runner.now() + deadline))
            try:
                async with asyncio.timeout(deadline + 20.0):
                    await realm_client.call(
                        name, "drive", {"ticket": ticket, "seconds": seconds}, deadline=deadline
                    )
            except TimeoutError:
                self.judge.complain(f"call {ticket} of {name} never ends")
            except VrError as error:
                self.answered += 1
                self.world.note(operator, f"call {ticket} of {name}", f"{type(error).__name__}: {error}")
            else:
                self.answered += 1
                self.world.note(operator, f"call {ticket} of {name}", "done")
                self._expect_done(name, ticket)
                if now >= PROBE:
                    self.whole = "yes"

        self._as_operator(now, call, operator=operator)

    def _call_and_cancel(self) -> None:
        """Call a free cart and cancel the call at once: one may overtake the other."""
        name, ticket = self.chance.choice(["cart-3", "cart-4"]), self._ticket + 1
        self._ticket = ticket
        pause = self.chance.uniform(0.0, 0.3)

        async def both(realm_client: RealmClient) -> None:
            self.judge.deadlines[ticket] = self.world.runner.now() + 5.0
            robot = RobotClient(
                self.realm.processes["operator-1"].transport, await realm_client.directory.resolve(name)
            )
            key = fresh_key()
            arguments = {"ticket": ticket, "seconds": 0.5}
            calling = asyncio.ensure_future(
                robot.call("drive", arguments, key=key, deadline=5.0, caller=CALLER)
            )
            await asyncio.sleep(pause)
            try:
                await robot.cancel(key)
                if not any(ticket == one for _, _, one, _ in self.realm.begun):
                    under_way = 0.1 + self.realm.controllers[name].slowest
                    self.judge.cancelled[ticket] = self.world.runner.now() + under_way
            finally:
                await asyncio.wait([calling])
                calling.exception()

        self._as_operator(self.world.runner.now(), both, f"call and cancel {ticket} of {name}")

    def _expect_done(self, name: str, ticket: int) -> None:
        begun = {one for _, _, one, _ in self.realm.begun}
        for leaf in leaf_tickets(name, ticket):
            if leaf not in begun:
                self.judge.complain(f"call {ticket} of {name} was answered, but drive {leaf} never began")

    def _stop(self) -> None:
        chance, now = self.chance, self.world.runner.now()
        name = chance.choice([None, None, "train", "pair", "cart-3"])
        released = now + chance.uniform(0.5, 4.0)
        self._order_stop(now, name)
        self._order_resume(released, name)
        for _ in range(3):
            self.world.runner.at(chance.uniform(now, released + 1.0), self._call)
        if chance.random() < 0.6:  # again, while the release may be under way
            self._order_stop(released + chance.uniform(0.0, 0.3), name)
            self._order_resume(released + chance.uniform(3.0, 5.0), name)

    def _order_stop(self, when: float, name: str | None) -> None:
        async def stop(realm_client: RealmClient) -> None:
            releases = self._releases
            for one in await realm_client.stop(name):
                if one in self.realm.controllers and releases == self._releases:
                    self.judge.stopped[one] = self.world.runner.now()

        self._as_operator(when, stop, f"stop {name}")

    def _order_resume(self, when: float, name: str | None, operator: str = "operator-1") -> None:
        async def resume(realm_client: RealmClient) -> None:
            self._releases += 1
            self.judge.stopped.clear()
            await realm_client.resume(name)

        self._as_operator(when, resume, f"resume {name}", operator=operator)

    def _bind_otherwise(self) -> None:
        """Move a cart to the other pair, or back."""
        slot, cart = self.chance.choice([("left", "cart-1"), ("right", "cart-2")])
        one, other = ("pair", "spare") if ("pair", slot) in self.bonds else ("spare", "pair")
        del self.bonds[one, slot]
        self.bonds[other, slot] = cart

        async def move(realm_client: RealmClient) -> None:
            await realm_client.release(one, slot)
            await realm_client.enslave(other, slot, cart)

        self._as_operator(self.world.runner.now(), move, f"move {cart} from {one} to {other}")

    def _probe(self) -> None:
        self.judge.stopped.clear()
        self._ticket += 1
        self._drive("train", self._ticket, 0.3, 7.0)

    # -- what goes wrong --------------------------------------------------------------------------

    def _go_wrong(self) -> None:
        self.faults += 1
        fault = self.chance.choice(
            [
                self._kill,
                self._kill,
                self._pause,
                self._pause,
                self._reset,
                self._cut,
                self._cable,
                self._weather,
            ]
        )
        fault()

    def _victim(self) -> str:
        return self.chance.choice([name for name in self.realm.processes if name != "operator-1"])

    def _kill(self) -> None:
        name, chance = self._victim(), self.chance
        process = self.realm.processes[name]
        after = chance.uniform(0.3, 3.0)
        if name in self.realm.controllers and chance.random() < 0.3:
            self._slow_down(name)
        if chance.random() < 0.4:
            process.vanish()
            after += self.world.network.lease
        else:
            process.kill()
        self._for(after, lambda: self._revive(name))

    def _revive(self, name: str) -> None:
        if not self.realm.processes[name].alive:
            self.realm.start(name)

    def _pause(self) -> None:
        process = self.realm.processes[self._victim()]
        process.pause()
        self._for(self.chance.uniform(0.2, 6.0), process.resume)

    def _reset(self) -> None:
        one, other = self._two()
        self.world.note(one, f"is reset with {other}")
        network, processes = self.world.network, self.realm.processes
        network.reset(processes[one].transport, processes[other].transport)

    def _cut(self) -> None:
        one, other = (self.realm.processes[name].transport for name in self._two())
        network = self.world.network
        self.world.note(one.name, f"is cut off from {other.name}")
        if self.chance.random() < 0.5:
            network.cut(one, other)
        else:
            network.cut_one_way(one, other)
        self._for(self.chance.uniform(0.5, 6.0), lambda: network.heal(one, other))

    def _two(self) -> list[str]:
        return self.chance.sample(list(self.realm.processes), 2)

    def _cable(self) -> None:
        name = self.chance.choice(list(self.realm.controllers))
        controller, chance = self.realm.controllers[name], self.chance
        what = chance.random()
        if what < 0.35:
            controller.cut()
            self._for(chance.uniform(0.2, 4.0), controller.mend)
        elif what < 0.6:
            self._power_cycle(name)
        else:
            self._slow_down(name)

    def _slow_down(self, name: str) -> None:
        controller, chance = self.realm.controllers[name], self.chance
        self.world.note(name, "slow")
        controller.slow_down(chance.uniform(0.0, 1.0), chance.uniform(0.0, 0.5))
        self._for(chance.uniform(1.0, 5.0), controller.calm)

    # -- scenes: faults at the worst moment -----------------------------------------------------

    def _scenes(self) -> list[Callable[[], None]]:
        return [
            self._the_program_that_asked_dies,
            self._the_proxy_of_a_moving_cart_is_paused,
            self._the_controller_of_a_moving_cart_restarts,
            self._the_controller_is_slow_to_answer,
            self._a_parent_is_paused_at_the_deadline,
            self._a_stopped_controller_restarts,
            self._goals_of_a_dead_proxy_arrive_late,
        ]

    def _drive_long(self, name: str, seconds: float, deadline: float, operator: str = "operator-1") -> None:
        self._ticket += 1
        self._drive(name, self._ticket, seconds, deadline, operator)

    def _the_program_that_asked_dies(self) -> None:
        self._drive_long("cart-4", 12.0, 20.0, "operator-2")
        self._after(1.5, self.realm.processes["operator-2"].kill)
        self._after(3.0, lambda: self._revive("operator-2"))

    def _the_proxy_of_a_moving_cart_is_paused(self) -> None:
        self._drive_long("cart-3", 9.0, 12.0)
        proxy = self.realm.processes["cart-3"]
        self._after(1.0, proxy.pause)
        self._after(7.0, proxy.resume)

    def _the_controller_of_a_moving_cart_restarts(self) -> None:
        self._drive_long("cart-4", 4.0, 9.0)
        self._after(1.5, lambda: self._power_cycle("cart-4"))

    def _the_controller_is_slow_to_answer(self) -> None:
        self.realm.controllers["cart-3"].slow_down(0.8, 0.2)
        self._drive_long("cart-3", 1.0, 9.0)
        self._after(4.0, self.realm.controllers["cart-3"].calm)

    def _a_parent_is_paused_at_the_deadline(self) -> None:
        self._drive_long("pair", 8.0, 2.0)
        self._drive_long("train", 8.0, 2.0)
        host = self.realm.processes["host-1"]
        self._after(1.8, host.pause)
        self._after(6.0, host.resume)

    def _a_stopped_controller_restarts(self) -> None:
        now = self.world.runner.now()
        self._order_stop(now, "cart-4")
        self._after(1.0, lambda: self._power_cycle("cart-4"))
        self._order_resume(now + 8.5, "cart-4")

    def _goals_of_a_dead_proxy_arrive_late(self) -> None:
        name = self.chance.choice(["cart-3", "cart-4"])
        controller = self.realm.controllers[name]
        controller.slow_down(SLOW_WAY, 0.0)
        self._drive_long(name, 3.0, 9.0)
        self._after(0.3, self.realm.processes[name].kill)
        self._after(0.4, controller.calm)
        self._after(0.5, lambda: self._revive(name))
        self._after(1.2, lambda: self._drive_long(name, 0.5, 5.0, "operator-2"))

    def _a_stop_crosses_a_release(self) -> None:
        """Two operators: one releases the stop of a cart while the other one stops it again."""
        network, at = self.world.network, self.world.runner.at
        one, other = (self.realm.processes[name].transport for name in ("operator-2", "cart-3"))
        network.weather.jitter = 0.1

        def hold_up(begin: float) -> None:
            # what is in force has been asked for; the release itself is held up
            at(begin + 0.9, lambda: network.cut_one_way(one, other))
            at(begin + 1.5, lambda: network.heal(one, other))

        self._cross(hold_up)
        self._after(6.5, self._clear_up)

    def _cross(self, hold_up: Callable[[float], None]) -> None:
        """Stop and release a cart twice; each release is held up, from some time after this moment."""
        chance, now = random.Random(f"{self.world.seed} crossing"), self.world.runner.now()
        for begin in (now, now + 3.0):
            self._order_stop(begin, "cart-3")
            self._order_resume(begin + 0.8, "cart-3", "operator-2")
            hold_up(begin)
            self._order_stop(begin + chance.uniform(1.06, 1.1), "cart-3")
            for later in (1.8, 2.2):
                self.world.runner.at(begin + later, lambda: self._drive_long("cart-3", 0.3, 2.0))
        self._order_resume(now + 6.0, "cart-3")

    def _power_cycle(self, name: str) -> None:
        # until its proxy has stopped it again it may move
        if name in self.judge.stopped:
            self.judge.stopped[name] = self.world.runner.now() + RESTOPPED
        self.realm.controllers[name].power_cycle()

    def _weather(self, until: float = 0.0) -> None:
        network, chance = self.world.network, self.chance
        weather = network.weather
        self.world.note("network", "bad weather")
        weather.jitter, weather.duplication, weather.loss = (
            chance.uniform(0.0, WORST_JITTER),
            chance.uniform(0.0, 0.5),
            chance.uniform(0.0, 0.3),
        )
        self._for(until or chance.uniform(2.0, 10.0), self._clear_up)

    def _clear_up(self) -> None:
        weather = self.world.network.weather
        weather.jitter = weather.duplication = weather.loss = 0.0

    def _heal(self) -> None:
        self.bonds = dict(BONDS)
        super()._heal()
        for name in list(self.realm.processes):
            self._revive(name)


def play(seed: int, *, keep: bool = False, reloads: int = 0) -> Outcome:
    """Play one seed to its end.

    Args:
        seed: of everything.
        keep: whether to keep the trace.
        reloads: how often, at moments drawn from the seed, all robots go on from their encoded states.
    """
    with World(seed) as world:
        story = Story(seed, world)
        moments = random.Random(f"{seed} reloads")
        for _ in range(reloads):
            world.runner.at(moments.uniform(0.0, LENGTH), world.reload)
        tell(story)
        outcome = Outcome(
            seed,
            world.digest,
            story.judge.broken,
            drives=len(story.realm.begun),
            calls=story.calls,
            answered=story.answered,
            faults=story.faults,
            events=len(world.trace),
            trace=list[object](world.trace) if keep else [],
        )
        del story  # so that the collection at the end of the world finds it
    return outcome
