"""Two proxies in one realm command one controller, which reports the epoch that it obeys and refuses none."""

from __future__ import annotations

import asyncio
import random
from functools import partial

import pytest

from robotree.protocol.services.fence import Fence
from robotree.vr.base.errors import StaleEpoch, VrError
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.world import World
from tests.world.controller import CartController
from tests.world.realm import Realm
from tests.world.safeguards import without

LENGTH = 30.0
"""[s] of virtual time."""
RIVAL = "cart-9"
"""The second proxy of the controller of `cart-1`."""


class OpenFence(Fence):
    """Remembers the highest epoch, and refuses none: a controller that leaves it to its proxies."""

    def objection(self, epoch: int) -> None:
        """See `Fence.objection`."""

    def admit(self, epoch: int) -> None:
        """See `Fence.admit`."""
        self.epoch = max(self.epoch, epoch)


class Rivalry:
    """`pair` commands `cart-1` and `cart-2`; then a rival with a later epoch moves `cart-1`."""

    def __init__(self, seed: int, world: World) -> None:
        self.world = world
        self.realm = Realm(world, lookups=1, hosts=1, carts=2)
        controller = CartController(world, "cart-1", tell=self.realm._begin, claims=False, fence=OpenFence())
        self.realm.controllers |= {"cart-1": controller, RIVAL: controller}
        self.chance = random.Random(f"{seed} rivalry")
        self.refused = 0
        """Calls of `pair` that were refused because of their epoch."""

    def tell(self) -> None:
        at, chance = self.world.runner.at, self.chance
        at(0.5, lambda: self._do("operator-1", self._bind))
        at(chance.uniform(8.0, 14.0), lambda: self.realm.start(RIVAL))
        for number in range(1, 21):
            at(chance.uniform(4.0, LENGTH - 4.0), partial(self._drive, "operator-1", "pair", number))
        for number in range(21, 26):
            at(chance.uniform(16.0, LENGTH - 4.0), partial(self._drive, "operator-2", RIVAL, number))
        self.world.run(LENGTH)
        assert not self.world.complaints

    @property
    def epochs(self) -> list[int]:
        """Of the drives of `cart-1`, in the order in which they began."""
        return [epoch for _, cart, _, epoch in self.realm.begun if cart == "cart-1"]

    def _do(self, operator: str, work: object) -> None:
        realm_client = self.realm.realm_clients[operator]
        self.realm.processes[operator].do(lambda: work(realm_client))  # type: ignore[operator]

    async def _bind(self, realm_client: RealmClient) -> None:
        await self.realm.create(realm_client, "host-1", "pair", "Pair")
        for slot, cart in (("left", "cart-1"), ("right", "cart-2")):
            await realm_client.enslave("pair", slot, cart)
            await asyncio.sleep(0.1)

    def _drive(self, operator: str, name: str, ticket: int) -> None:
        async def call(realm_client: RealmClient) -> None:
            try:
                await realm_client.call(name, "drive", {"ticket": ticket, "seconds": 0.2}, deadline=5.0)
            except StaleEpoch:
                self.refused += 1
            except VrError as error:
                self.world.note(operator, f"{name} drives in vain", str(error))

        self._do(operator, call)


def told(seed: int) -> tuple[list[int], int]:
    """Return the epochs of the drives of one story, and how many calls were refused for their epoch."""
    with World(seed) as world:
        story = Rivalry(seed, world)
        story.tell()
        outcome = story.epochs, story.refused
        del story  # what it held ends with the world
    return outcome


@pytest.mark.parametrize("seed", range(2))
def test_a_proxy_sends_nothing_under_an_epoch_that_its_controller_has_left_behind(seed: int) -> None:
    epochs, refused = told(seed)
    assert len(set(epochs)) == 2, "both have driven"
    assert epochs == sorted(epochs)
    assert refused >= 1
    with without("a proxy refuses an epoch older than one that it obeyed"):
        epochs, _ = told(seed)
    assert epochs != sorted(epochs)
