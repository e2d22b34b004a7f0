"""Stories of hosts that keep their robots, and end at any moment of their work.

A story lasts 20 s. Until 9 s operators call, stop, cancel, bind anew and delete, while hosts end at chosen
moments, lose their power, find their disks full or as they were before; proxies and controllers fail, too.
Then all is healed, and at 16 s a call through the whole tree must succeed. In a *calm* story only processes
of hosts end, and are started again at once: there each call must succeed.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any

from robotree.vr.base.errors import NoSuchRobot, Unreachable, VrError
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.asking import fresh_key
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.supervision.realm_client import CALLER, RealmClient
from robotree.vr.world.world import World
from tests.world.keeping import MOMENTS, RETURNS, KeepingRealm
from tests.world.machine import errors_kept, tell
from tests.world.realm import CartProxy, lease_of
from tests.world.story import Deeds, Judge, Judged

LENGTH, BUILT, CALM, PROBE = 20.0, 2.0, 9.0, 16.0
"""[s] of a story; from when on operators call; from when on nothing goes wrong; when all must be whole."""
DEADLINE = 5.0
"""[s] of a call."""
ENDS = 12.0
"""[s] after which each call has ended: its deadline, the absence of a host, and a clean-up."""
TRUSTING = RETURNS + 2.0
"""[s] that a parent which is back may be wrong about its children."""
PARTS = 100
"""Drives that one call may lead to: their tickets are that of the call times this, and a number."""
SOURCE = '''
from robotree.vr import Child, VirtualRobot, command, state

class Helper(VirtualRobot):
    """Has a cart of its own."""
    cart = Child("CartProxy")
    helped: int = state(0)

    @command
    def drive(self, ticket: float, seconds: float) -> float:
        self.cart.drive(ticket=ticket, seconds=seconds)
        self.helped += 1
        return ticket

class Guide(VirtualRobot):
    """Takes steps of all kinds; each command returns the tickets of the drives that it believes done."""
    cart = Child("CartProxy")
    helper = Child("Helper")
    done: int = state(0)
    tickets: list[float] = state([])

    @command
    def tour(self, ticket: float, seconds: float) -> list[float]:
        began, dice, before = self.now(), [0.0], self.done
        for n in range(4):
            dice.append(self.random())
            (self.helper if n % 2 else self.cart).drive(ticket=ticket + n, seconds=seconds)
            self.done += 1
            self.tickets = [*self.tickets[-9:], ticket + n]
            self.sleep(seconds / 4)
            assert self.now() >= began
        assert len(set(dice)) == len(dice)
        assert self.done == before + 4, f"{self.done} after {before}"
        return [ticket + n for n in range(4)]

    @command
    def pairs(self, ticket: float, seconds: float) -> list[float]:
        with self.together() as both:
            both.start(self.cart.drive, ticket=ticket, seconds=seconds)
            both.start(self.helper.drive, ticket=ticket + 1, seconds=2 * seconds)
        with self.together() as both:
            both.start(self.helper.drive, ticket=ticket + 2, seconds=seconds)
            both.start(self._row, ticket + 3, seconds)
        return [ticket, ticket + 1, ticket + 2, ticket + 3, ticket + 4]

    def _row(self, ticket, seconds):
        for n in range(2):
            self.cart.drive(ticket=ticket + n, seconds=seconds)
            self.sleep(0.01)

    @command
    def race(self, ticket: float, seconds: float) -> list[float]:
        with self.first() as winner:
            winner.start(self.cart.drive, ticket=ticket, seconds=seconds)
            winner.start(self.helper.drive, ticket=ticket + 1, seconds=3 * seconds)
        self.cart.drive(ticket=ticket + 2, seconds=seconds)
        return [ticket + winner.winner, ticket + 2]

    @command
    def careful(self, ticket: float, seconds: float) -> list[float]:
        try:
            self.helper.drive(ticket=ticket, seconds=seconds)
            self.sleep(seconds)
        finally:
            with self.cleanup(within=3.0):
                self.cart.drive(ticket=ticket + 1, seconds=0.05)
        return [ticket, ticket + 1]

    @command
    def telling(self, ticket: float, seconds: float) -> list[float]:
        self.helper.drive.tell(ticket=ticket, seconds=seconds)
        self.cart.drive(ticket=ticket + 1, seconds=seconds)
        self.helper.drive(ticket=ticket + 2, seconds=seconds)
        return [ticket + 1, ticket + 2]

    @command
    def rounds(self, ticket: float, seconds: float) -> list[float]:
        first = self.done
        while self.done < first + 3:
            self.cart.drive(ticket=ticket + self.done - first, seconds=seconds)
            self.done += 1
        return [ticket, ticket + 1, ticket + 2]

    @command
    def still(self, ticket: float, seconds: float) -> list[float]:
        """Change what is kept, and ask nobody."""
        for n in range(4):
            self.done += 1
            self.sleep(seconds / 4)
        self.tickets = [*self.tickets[-9:], ticket]
        return []
'''
COMMANDS = ("tour", "tour", "pairs", "race", "careful", "telling", "rounds", "still")
ROBOTS = {"guide": "Guide", "helper": "Helper", "spare": "Helper"}
BONDS = (("helper", "cart", "cart-2"), ("guide", "cart", "cart-1"), ("guide", "helper", "helper"))
"""Parents, slots, and children, at first and at the end."""


class KeepingJudge(Judge):
    """Watches a realm whose hosts come back."""

    realm: KeepingRealm
    held: dict[str, float]
    """Robots of hosts whose stop was confirmed and that nobody has released since."""

    def __init__(self, realm: KeepingRealm) -> None:
        super().__init__(realm)
        self.held = {}
        self.forgetful = False
        """Whether a host was started from an old copy of its disk: then a proxy may be told once more what it
        has done and forgotten, and only its controller knows the key."""

        self.amnesia = False
        """Whether a controller has lost its power: then it does not know its keys any more."""

    def forget_drives(self) -> None:
        """Take note of an old copy: a command that goes on from it may take other steps, with other keys."""
        self.forgetful = True
        self._look_at_drives()
        self._tickets.clear()

    def _look_at_drives(self) -> None:
        if self.forgetful and self.amnesia:
            self._tickets.clear()
        super()._look_at_drives()

    def look_at_call(self, cart: CartProxy) -> None:
        if self.forgetful:
            self._keys.discard((cart, cart.context.key))
        super().look_at_call(cart)

    def look(self) -> None:
        super().look()
        self._look_at_stops()

    def _look_at_bonds(self) -> None:
        """See `Judge`. A parent that is just back believes that its children wait, until it knows better."""
        started = (self.realm.processes[name].started for name in self.realm.keeps)
        if self.world.runner.now() > max(started) + TRUSTING:
            super()._look_at_bonds()

    def _look_at_stops(self) -> None:
        for name, agent in self.realm.agents().items():
            if name in self.held and not agent.runtime.core.state.stop.in_force:
                self.complain(f"{name} is not stopped any more, and nobody has released it")


class CrashStory(Judged, Deeds):
    """What happens to one realm."""

    realm_class: type[KeepingRealm] = KeepingRealm
    judge_class: type[KeepingJudge] = KeepingJudge

    def __init__(self, seed: int, world: World) -> None:
        self.world, self.realm = world, self.realm_class(world)
        self.judge = self.judge_class(self.realm)
        self.realm.complain = self.judge.complain
        self.processes, self.realm_clients = self.realm.processes, self.realm.realm_clients
        self.chance = random.Random(f"{seed} crashes")
        self.calm = self.chance.random() < 0.4
        self.where = {
            "guide": "host-1",
            "helper": self.chance.choice(["host-1", "host-2"]),
            "spare": "host-2",
        }
        self.bonds = {(parent, slot): child for parent, slot, child in BONDS}
        self.open: dict[str, float] = {}
        self.calls = self.done = self.ends = 0
        self._forgotten: Counter[str] = Counter()
        """How often each robot may have lost its stop: also one that is just being confirmed."""
        self.whole = False
        self._copies: dict[str, Any] = {}
        for name in self.realm.keeps:
            self._watch(name)

    def tell(self) -> None:
        self.plan()
        self.world.run(LENGTH)
        self._check()

    def plan(self) -> None:
        """Enter what happens, and when."""
        world, chance, at = self.world, self.chance, self.world.runner.at
        preemption = world.runner.preemption
        share = chance.choice([0.0, 0.02, 0.1])
        preemption.starve = chance.choice([0.0, 0.0, 0.01])
        for keep in self.realm.keeps.values():
            keep.slow = chance.choice([0.0, 0.0, 0.02])
        self.judge.look()
        at(0.4, lambda: self._as_operator(self._build(), "build"))
        at(BUILT, lambda: setattr(preemption, "share", share))
        for _ in range(chance.randrange(3, 7)):
            at(chance.uniform(BUILT, CALM - 3.0), self._call)
        for _ in range(chance.randrange(1, 4)):
            at(chance.uniform(BUILT, CALM - 3.0), self._end_a_host)
        for _ in range(0 if self.calm else chance.randrange(1, 5)):
            at(chance.uniform(BUILT, CALM - 1.0), chance.choice(self._deeds()))
        at(CALM, self._heal)
        for later in (2.0, 4.5):  # a parent may still wait for its children
            at(CALM + later, lambda: self._as_operator(self._release(None), "release"))
        for later in (3.0, 5.5):  # a child may still wait for a parent that does not come back
            at(CALM + later, lambda: self._as_operator(self._build(), "build again"))
        at(PROBE, lambda: self._begin("guide", "tour", 0.1, "operator-1"))

    # -- operators --------------------------------------------------------------------------------

    async def _build(self) -> None:
        """Create and bind what is missing, and tell what is bound otherwise."""
        realm_client = self.realm.realm_clients["operator-1"]
        there = {address.name for address in realm_client.directory.present("robot")}
        for name, kind in ROBOTS.items():
            if name not in there:
                host = await realm_client.directory.resolve(self.where[name], "host")
                client = HostClient(realm_client._transport, host)
                await client.create(Bundle(SOURCE, "/guides.py", kind), name)
        for (parent, slot), child in self.bonds.items():
            await self._bind(realm_client, parent, slot, child)

    async def _bind(self, realm_client: RealmClient, parent: str, slot: str, child: str) -> None:
        for other in ROBOTS:
            for each in (await realm_client.describe(other)).slots:
                wanted = (other, each.name) == (parent, slot)
                if each.child is not None and (each.child.name == child) != wanted:
                    with contextlib.suppress(VrError):
                        await realm_client.release(other, each.name)
        try:
            await realm_client.enslave(parent, slot, child)
        except VrError as error:
            self.world.note("operator-1", f"bind {child} to {parent}", f"{type(error).__name__}: {error}")

    async def _release(self, name: str | None) -> None:
        self._forget_stops(*ROBOTS, *self.realm.controllers)
        await self.realm.realm_clients["operator-1"].resume(name)

    def _call(self) -> None:
        self._begin(
            "guide", self.chance.choice(COMMANDS), self.chance.choice([0.05, 0.1, 0.3]), self._operator()
        )

    def _operator(self) -> str:
        return "operator-1" if self.calm else self.chance.choice(["operator-1", "operator-1", "operator-2"])

    def _begin(self, name: str, command: str, seconds: float, operator: str) -> None:
        self.calls += 1
        label = f"{name}.{command} {self.calls}"
        work = self._follow(label, name, command, float(self.calls * PARTS), seconds, operator)
        self._as_operator(work, label, operator)

    async def _follow(
        self, label: str, name: str, command: str, ticket: float, seconds: float, operator: str
    ) -> None:
        now, deadline = self.world.runner.now(), 3 * DEADLINE if self.calm else DEADLINE
        self.open[label] = now + (ENDS if not self.calm else inf)
        tickets = range(int(ticket), int(ticket) + 9)
        self.judge.deadlines.update(
            dict.fromkeys(tickets, now + deadline + (3.0 if command == "careful" else 0.0))
        )
        self.realm.processes[operator].on_exit.append(lambda: self.open.pop(label, None))
        client = self.realm.realm_clients[operator]
        try:
            result = await self._call_until_taken(
                client, name, command, {"ticket": ticket, "seconds": seconds}, deadline
            )
        except VrError as error:
            self.world.note(operator, label, f"{type(error).__name__}: {error}")
            if self.calm:
                self.judge.complain(f"{label} fails in a calm story: {type(error).__name__}: {error}")
        else:
            self.done += 1
            begun = {each for _, _, each, _ in self.realm.begun}
            for each in result if isinstance(result, list) else [result]:
                if round(each) not in begun:
                    self.judge.complain(f"{label} was answered, but drive {each} never began")
            self.whole = self.whole or now >= PROBE
        if self.open.pop(label, None) is None:
            self.judge.complain(f"{label} ends twice")

    async def _call_until_taken(
        self, client: RealmClient, name: str, command: str, arguments: dict[str, Any], deadline: float
    ) -> Any:
        """Call a robot; in a calm story again under the same key, as long as nobody has accepted it."""
        if not self.calm:
            return await client.call(name, command, arguments, deadline=deadline)
        key, caller = fresh_key(), await client.caller()
        while True:
            try:
                robot = RobotClient(client._transport, await client.directory.resolve(name))
                return await robot.call(
                    command, arguments, deadline=deadline, key=key, caller=CALLER, sender=caller
                )
            except (NoSuchRobot, Unreachable):
                await asyncio.sleep(0.05)

    # -- ends of hosts ----------------------------------------------------------------------------

    def _watch(self, name: str) -> None:
        """Start a host again whenever it has ended."""
        self.realm.processes[name].on_exit.append(
            lambda: self._after(self._pause(), lambda: self._revive(name))
        )

    def _pause(self) -> float:
        return self.chance.choice([0.05, 0.3, 0.3, 1.0] if self.calm else [0.05, 0.3, 1.0, RETURNS + 2.0])

    def _revive(self, name: str) -> None:
        if not self.realm.processes[name].alive:
            self.realm.start(name)
            if name in self.realm.keeps:
                self._watch(name)

    def _end_a_host(self) -> None:
        """Have a host end at a moment of its work, and perhaps its next life, too."""
        chance, name = self.chance, self.chance.choice(["host-1", "host-1", "host-2"])
        moments = [(chance.choice(MOMENTS), chance.choice([1, 2, 3, 5, 8, 13, 21, 34]))]
        if chance.random() < 0.3:
            moments.append((chance.choice(MOMENTS), chance.choice([1, 2, 3, 5, 8])))
        self._arm(name, moments)

    def _arm(self, name: str, moments: list[tuple[str, int]]) -> None:
        """Have a host end at moments of its next lives."""
        self.ends += 1
        self.world.note("story", f"{name} is to end", str(moments))
        self.realm.count.pop(name, None)
        self.realm.armed[name] = moments

    # -- what else happens ------------------------------------------------------------------------

    def _deeds(self) -> list[Callable[[], None]]:
        return [
            *[self._lose_power] * 3,
            self._switch_off,
            self._fill_disk,
            self._break_disk,
            self._put_back,
            self._stop_and_release,
            self._cancel,
            self._move,
            self._delete,
            self._kill_operator,
            self._pause_host,
            self._kill_proxy,
            self._power_cycle,
            self._kill_two,
            self._call_spare,
        ]

    def _host(self) -> str:
        return self.chance.choice(["host-1", "host-1", "host-2"])

    def _lose_power(self) -> None:
        name = self._host()
        self._deed(f"{name} loses its power")
        process = self.realm.processes[name]
        (process.vanish if self.chance.random() < 0.5 else process.kill)()
        self._after_power(name)

    def _after_power(self, name: str) -> None:
        keep = self.realm.keeps[name]
        keep.medium.lose_power(self.chance)
        keep.lost_power, keep.boots = True, keep.boots + 1
        self._forget_stops(*self._robots_of(name))

    def _robots_of(self, host: str) -> list[str]:
        """Robots whose stops may not be on the host's disk any more."""
        return [robot for robot, where in self.where.items() if where == host]

    def _forget_stops(self, *robots: str) -> None:
        self._forgotten.update(robots)
        for robot in robots:
            self.judge.held.pop(robot, None)
            self.judge.stopped.pop(robot, None)

    def _switch_off(self) -> None:
        """Switch the machine of all processes off and on: its clock begins anew. The controllers go on."""
        self._deed("the machine is switched off")
        for process in self.realm.processes.values():
            process.kill()
        for name in self.realm.keeps:
            self._after_power(name)
        self.realm.offset = self.chance.choice([0.0, 100.0]) - self.world.runner.now()
        self.realm.realm_clients.clear()
        for name in list(self.realm.processes):
            self._after(self.chance.choice([0.3, 0.5, 1.0]), partial(self._revive, name))

    def _fill_disk(self) -> None:
        name = self._host()
        self._deed(f"the disk of {name} is full")
        medium = self.realm.keeps[name].medium
        medium.room = self.chance.choice([0, 100, 3000])
        self._after(self.chance.uniform(0.2, 3.0), lambda: setattr(medium, "room", inf))

    def _break_disk(self) -> None:
        name = self._host()
        self._deed(f"the disk of {name} is read-only")
        medium = self.realm.keeps[name].medium
        medium.broken = True
        self._after(self.chance.uniform(0.2, 1.0), lambda: setattr(medium, "broken", False))

    def _put_back(self) -> None:
        """Start a host from an old copy of its disk, as a person does after a mistake."""
        name = self._host()
        self._deed(f"{name} gets an old copy")
        keep = self.realm.keeps[name]
        copy = keep.medium.copy()

        def put() -> None:
            if self.world.runner.now() > CALM:
                return
            self.realm.processes[name].kill()
            keep.medium.put_back(copy)
            keep.replaced = True
            self.judge.forget_drives()
            self.world.note("story", f"{name} has the old copy")
            self._forget_stops(*self._robots_of(name))

        self._after(self.chance.uniform(0.1, 2.0), put)

    def _stop_and_release(self) -> None:
        self._deed("stop")
        name = self.chance.choice([None, "guide", "helper"])
        self._as_operator(self._stop(name), "stop")
        self._after(self.chance.uniform(0.3, 4.0), lambda: self._as_operator(self._release(name), "release"))

    async def _stop(self, name: str | None) -> None:
        before = self._forgotten.copy()
        for robot in await self.realm.realm_clients["operator-1"].stop(name):
            if self._forgotten[robot] == before[robot]:
                stops = self.judge.held if robot in ROBOTS else self.judge.stopped
                stops[robot] = self.world.runner.now()

    def _cancel(self) -> None:
        self._deed("cancel")
        name = self.chance.choice(["guide", "helper"])

        async def cancel() -> None:
            await self.realm.realm_clients["operator-1"].cancel(name)

        self._as_operator(cancel(), "cancel")

    def _move(self) -> None:
        """Give the cart of the helper to another robot."""
        self._deed("move cart-2")
        self.bonds.pop(("helper", "cart"), None)
        self.bonds["spare", "cart"] = "cart-2"

        async def move() -> None:
            client = self.realm.realm_clients["operator-1"]
            await client.release("helper", "cart")
            await client.enslave("spare", "cart", "cart-2")

        self._as_operator(move(), "move")

    def _delete(self) -> None:
        self._deed("delete spare")

        async def delete() -> None:
            await self.realm.realm_clients["operator-1"].delete("spare")
            self._forget_stops("spare")
            await self._build()

        self._as_operator(delete(), "delete")

    def _call_spare(self) -> None:
        self._deed("call spare")
        self._begin("spare", "drive", 0.1, "operator-1")

    def _kill_operator(self) -> None:
        self._end_operator(partial(self._revive, "operator-2"))

    def _pause_host(self) -> None:
        name = self._host()
        self._deed(f"pause {name}")
        process = self.realm.processes[name]
        process.pause()
        self._after(self.chance.choice([0.1, 1.0, 4.0]), process.resume)

    def _kill_proxy(self) -> None:
        name = self.chance.choice(["cart-1", "cart-2"])
        self._deed(f"kill {name}")
        self.realm.processes[name].kill()
        self._after(self.chance.choice([0.3, 1.0, 3.0]), lambda: self._revive(name))

    def _power_cycle(self) -> None:
        name = self.chance.choice(["cart-1", "cart-2"])
        self._deed(f"power cycle {name}")
        self._cycle(name)

    def _cycle(self, cart: str) -> None:
        self._forget_stops(cart)
        self.judge.amnesia = True
        self.realm.controllers[cart].power_cycle()

    def _kill_two(self) -> None:
        host, cart = self._host(), self.chance.choice(["cart-1", "cart-2"])
        self._deed(f"kill {host} and {cart}")
        self.realm.processes[host].kill()
        self._kill_proxy()
        if self.chance.random() < 0.5:
            self._cycle(cart)

    # -- the laws ---------------------------------------------------------------------------------

    def _heal(self) -> None:
        self.world.runner.preemption.share = 0.0
        self.bonds = {(parent, slot): child for parent, slot, child in BONDS}
        self.realm.armed.clear()
        for keep in self.realm.keeps.values():
            keep.medium.room, keep.medium.broken, keep.slow = inf, False, 0.0
        for name, process in list(self.realm.processes.items()):
            process.resume()
            self._revive(name)

    def _check(self) -> None:
        complain = self.judge.complain
        for complaint in self.world.complaints:
            complain(f"complaint: {complaint}")
        if not self.whole:
            complain("the realm is not whole again")
        agents = self.realm.agents()
        for (parent, _), child in self.bonds.items():
            lease = lease_of(agents[child]) if child in agents else None
            if lease is None or lease.parent.name != parent:
                complain(f"{child} has {lease and lease.parent.name} as its parent, not {parent}")
        for wrong in self._undone(self.open, agents):
            complain(wrong)


def play(seed: int, kind: type[CrashStory] = CrashStory) -> tuple[str, CrashStory]:
    """Play one seed to its end.

    Returns:
        The digest of its trace, and the story.
    """
    logged: list[str] = []
    with World(seed) as world, errors_kept(logged):
        story = kind(seed, world)
        tell(story)
        for line in logged:
            if "would not survive its end now" in line or "can neither be written" in line:
                continue  # a disk was full, or read-only
            story.judge.complain(f"logged: {line}")
        return world.digest, story
