"""Stories of directories that lose each other: orders are left, cancelled and taken in parts of a network.

Three directories, a rover that is switched on and off, and two people. For 60 s directories die or lose sight
of each other and of the rest, the rover loses its power in the middle, orders are left and cancelled wherever
somebody answers, and stops hold whom they reach. Then all is healed.

The laws: what may be done once begins once at most; an order whose cancel all its holders have confirmed does
not begin afterwards; nothing begins while all directories hold the rover; when all is healed the directories
say the same, and each order that was acknowledged is there and over, as what it has done.
"""

from __future__ import annotations

import asyncio
import hashlib
import random
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path

from robotree.vr.base.chance import drawn_from
from robotree.vr.base.errors import VrError
from robotree.vr.orders.ledger import Ledger
from robotree.vr.orders.service import DirectoryService
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner
from tests.vr.orders.conftest import Rover, Stage

NAMES = ("d1", "d2", "d3")
PEOPLE = ("anna", "bela")
EVENTS = 40
"""What goes wrong, or is asked for, in one story."""
PAUSE = 1.5
"""[s] at most between two events."""
CALM = 90.0
"""[s] in which everything is whole again: longer than all terms of directories and takers together."""


class OrderStory:
    """One story, from a seed."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.chance = random.Random(f"{seed} orders")
        self.stage = Stage(folder)
        self.ledger = Ledger(None)
        self.begun: list[str] = []
        """Keys of the motions that have begun, over all lives of the rover."""
        self.known: list[str] = []
        """Keys of the orders that were acknowledged, in the order in which they were."""
        self.once: set[str] = set()
        """Those of them that may be carried out once only."""
        self.safe: dict[str, int] = {}
        """How often each order had begun when the last holder of it had confirmed its cancel."""
        self.held: int | None = None
        """How many motions had begun when the last directory held the rover; None: not all do."""
        self.broken: list[str] = []
        self.trace: list[str] = []
        self.people: list[RealmClient] = []
        self.agent: object = None

    async def play(self) -> None:
        """Play it, and judge."""
        for name in NAMES:
            await self.stage.directory(name)
        self.people = [await self.stage.person(name) for name in PEOPLE]
        await self.switch_on()
        await self.stage.until(lambda: all(each.book.store.agents for each in self.stage.services))
        await self.switch_off()
        actions: list[Callable[[], Awaitable[None]]] = [
            *[self.leave] * 4,
            *[self.cancel] * 2,
            *[self.part] * 2,
            self.heal,
            *[self.switch_on] * 2,
            *[self.switch_off] * 2,
            self.directory_changes,
            self.hold,
            self.release,
        ]
        for _ in range(EVENTS):
            action = self.chance.choice(actions)
            self.trace.append(f"{self.stage.loop.time():.3f} {action.__name__}")
            try:
                await action()
            except VrError as error:
                self.trace.append(type(error).__name__)
            await asyncio.sleep(self.chance.uniform(0.01, PAUSE))
            self.look()
        await self.calm()
        await self.stage.close()

    # -- what happens -----------------------------------------------------------------------------

    async def leave(self) -> None:
        person, seconds = self.chance.choice(self.people), self.chance.choice((0.1, 1.0, 4.0))
        command = self.chance.choice(("drive", "drive", "go_to"))
        left = await person.orders.leave("r1", command, {"x": 1.0, "seconds": seconds}, begin_within=600.0)
        self.known.append(left.order.key)
        if command == "drive":
            self.once.add(left.order.key)

    async def cancel(self) -> None:
        if self.known:
            key = self.chance.choice(self.known)
            answer = await self.chance.choice(self.people).orders.cancel(key)
            if answer.order.state == "cancelled" and not answer.unconfirmed:
                self.safe.setdefault(key, self.begun.count(key))

    async def part(self) -> None:
        ways = self.stage.transports
        one, other = self.chance.sample([*NAMES, *PEOPLE, "r1"], 2)
        self.stage.network.cut(ways[one], ways[other])

    async def heal(self) -> None:
        ways = list(self.stage.transports.values())
        for one in ways:
            for other in ways:
                if one is not other:
                    self.stage.network.heal(one, other)

    async def switch_on(self) -> None:
        if self.agent is None:
            rover = Rover("r1")
            rover.done = self.begun
            self.agent = await self.stage.robot(rover, self.ledger)

    async def switch_off(self) -> None:
        if self.agent is not None:
            agent, self.agent = self.agent, None
            await self.stage.switch_off(agent)  # type: ignore[arg-type]

    async def directory_changes(self) -> None:
        name = self.chance.choice(NAMES)
        found: list[DirectoryService] = [each for each in self.stage.services if each.address.name == name]
        if not found:
            await self.stage.directory(name)
        elif len(self.stage.services) > 1:
            await self.stage.kill_directory(found[0])

    async def hold(self) -> None:
        """Hold the rover; if all directories do and it does nothing, it must stay so."""
        holding, silent = await self.people[0].orders.hold()
        all_hold = len(holding) == len(NAMES) and not silent
        busy = self.agent is not None
        self.held = len(self.begun) if all_hold and not busy else None

    async def release(self) -> None:
        self.held = None
        await self.people[0].orders.release()

    # -- the judge --------------------------------------------------------------------------------

    def look(self) -> None:
        if any(self.begun.count(key) > 1 for key in self.once):
            self.break_law("an order was carried out twice")
        if any(self.begun.count(key) > count for key, count in self.safe.items()):
            self.break_law("an order began after all had confirmed its cancel")
        if self.held is not None and len(self.begun) > self.held:
            self.break_law("an order began while all directories held its robot")

    def break_law(self, law: str) -> None:
        if law not in self.broken:
            self.broken.append(law)

    async def calm(self) -> None:
        """Heal everything, and see that all is told everywhere."""
        self.held = None
        for name in NAMES:
            if name not in {each.address.name for each in self.stage.services}:
                await self.stage.directory(name)
        await self.heal()
        await asyncio.sleep(10.0)
        for person in self.people:
            await person.orders.release()
        await self.switch_on()
        await asyncio.sleep(CALM)
        self.look()
        stores = [each.book.store for each in self.stage.services]
        orders = stores[0].orders
        if any((each.orders, each.holds) != (orders, stores[0].holds) for each in stores):
            self.break_law("directories that are together say different things")
        if any(key not in orders for key in self.known):
            self.break_law("an order that was acknowledged is lost")
        for key, order in orders.items():
            if not order.over:
                self.break_law("an order has no end")
            if order.state in {"refused", "cancelled", "expired"} and key in self.begun:
                self.break_law(f"an order that was {order.state} had begun")
            if order.state == "done" and key not in self.begun:
                self.break_law("an order is done that never began")
        states = sorted((key, order.state) for key, order in orders.items())
        self.trace.append(f"{sorted(self.begun)} {states}")


def play(seed: int) -> tuple[str, OrderStory]:
    """Play the story of a seed; returns the digest of its trace, and what the judge has seen."""
    loop = VirtualLoop(VirtualRunner(seed))
    asyncio.set_event_loop(loop)
    with tempfile.TemporaryDirectory() as folder, drawn_from(random.Random(f"{seed} keys").getrandbits):

        async def begin() -> OrderStory:
            story = OrderStory(seed, Path(folder))
            await story.play()
            return story

        async def end() -> None:
            left = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
            for task in left:  # of processes that were killed
                task.cancel()
            await asyncio.gather(*left, return_exceptions=True)

        try:
            story = loop.run_until_complete(begin())
            loop.run_until_complete(end())
        finally:
            asyncio.set_event_loop(None)
            loop.close()
    return hashlib.sha256("\n".join(story.trace).encode()).hexdigest(), story
