"""A realm for tests, its members and its sites: gateways over a hub that loses, holds back and forges.

In virtual time each machine is a `MemoryNetwork`; in real time it has the mesh of its processes.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.envelope import seal
from robotree.vr.base.pattern import matches
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import Call, Describe, Described, Done, Raised, SafeStop, decode_reply
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.dispatcher import Dispatcher
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.sites.certificates import Authority, MemberKind, Trust
from robotree.vr.sites.frames import SiteStopped
from robotree.vr.sites.gateway import Gateway
from robotree.vr.sites.handshake import Handshakes, Own
from robotree.vr.sites.invitations import read_token, request_to_join, token_of
from robotree.vr.sites.keys import RealmKeys, create
from robotree.vr.sites.keys import join as join_realm_keys
from robotree.vr.sites.networks import LinkState, OnArrival
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.virtual_loop import VirtualLoop
from tests.waiting import until
from tests.world.wide import MemoryGround

WALL = 1_800_000_000.0
"""[s since 1970] of the tests."""


def chance(seed: int) -> Callable[[int], bytes]:
    return random.Random(seed).randbytes


class Realm:
    """A realm with an authority."""

    def __init__(self, name: str = "cell", seed: int = 1) -> None:
        self.name, self.draw = name, chance(seed)
        self.authority = Authority(name, self.key())
        self.serials = 0

    def key(self) -> Ed25519PrivateKey:
        return Ed25519PrivateKey.from_private_bytes(self.draw(32))

    def trust(self) -> Trust:
        return Trust(self.name, self.authority.public)

    def own(self, name: str, kind: MemberKind = "site", *, now: float = WALL, days: float = 30) -> Own:
        key = self.key()
        self.serials += 1
        certificate = self.authority.admit(
            name, kind, key.public_key().public_bytes_raw(), serial=self.serials, now=now, days=days
        )
        return Own(certificate, key)

    def gateway(self, name: str, kind: MemberKind = "site") -> Handshakes:
        return Handshakes(self.own(name, kind), self.trust(), chance=self.draw)


class MemoryHub:
    """What joins the pipes of a test: it can lose, delay by holding back, repeat, reorder and inject."""

    def __init__(self) -> None:
        """Begin with no pipes, and deliver all."""
        self.pipes: list[MemoryPipe] = []
        self.on_way: Callable[[str, bytes], list[bytes]] = lambda _topic, body: [body]
        """What becomes of a message on its way."""
        self.up = True

    def carry(self, topic: str, body: bytes) -> None:
        """Deliver what was published."""
        if self.up:
            for one in self.on_way(topic, body):
                self.inject(topic, one)

    def inject(self, topic: str, body: bytes) -> None:
        """Deliver a message to all pipes, also one that no site has sent."""
        for pipe in list(self.pipes):
            pipe.take(topic, body)


class MemoryPipe:
    """A pipe to a `MemoryHub`."""

    def __init__(self, hub: MemoryHub) -> None:
        """Join the hub."""
        self._hub = hub
        self._subscribed: list[tuple[str, OnArrival]] = []
        hub.pipes.append(self)

    def publish(self, topic: str, body: bytes, *, to_all: bool = False) -> None:
        del to_all  # there is one hub
        self._hub.carry(topic, body)

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        self._subscribed.append((pattern, on_message))

    def hint(self, on_arrival: Callable[[], None]) -> None:
        del on_arrival  # nobody arrives unheard

    def state(self) -> LinkState:
        return LinkState(self._hub.up, "memory", "" if self._hub.up else "it is cut")

    def close(self) -> None:
        if self in self._hub.pipes:
            self._hub.pipes.remove(self)

    def take(self, topic: str, body: bytes) -> None:
        """Hand on what the hub delivers."""
        for pattern, on_message in self._subscribed:
            if matches(pattern, topic):
                on_message(topic, body)


ROBOT = "robot/arm-1/1"


class SiteOfTest:
    """One machine: its gateway, and a member that is an agent or asks one."""

    def __init__(self, place: Path, hub: MemoryHub, keys: RealmKeys) -> None:
        self.place, self.hub, self.keys = place, hub, keys
        self.network = MemoryNetwork(delay=0.001)
        self.asked: list[tuple[Any, Principal]] = []
        self.ahead = 0.0
        """[s] by which its clock is ahead."""

    def wall(self) -> float:
        return WALL + asyncio.get_running_loop().time() + self.ahead

    async def join(self) -> MemoryTransport | LocalTransport:
        if isinstance(asyncio.get_running_loop(), VirtualLoop):
            found: MemoryTransport | LocalTransport = self.network.join()
        else:
            self.place.mkdir(mode=0o700, exist_ok=True)
            found = await join("test", root=self.place)
        found.gate = PolicyFile(self.keys.folder.parent)
        return found

    async def open(self) -> None:
        self.gate, self.member = await self.join(), await self.join()

        async def stop_here(order: str, reason: str) -> SiteStopped:
            self.asked.append((SafeStop(order=order, reason=reason), Principal()))
            return SiteStopped(0, ["arm-1"], [], [])

        self.pipe = MemoryPipe(self.hub)
        self.gateway = Gateway(
            self.gate,
            self.pipe,
            self.keys,
            ground=MemoryGround(self.gate) if isinstance(self.gate, MemoryTransport) else self.gate.mesh,
            stop_here=stop_here,
            version="1.2.3",
            wall=self.wall,
        )
        await self.gateway.open()

    async def be_robot(self, reply: Any = None) -> None:
        """Answer requests to `ROBOT`, and note them."""
        loop = asyncio.get_running_loop()

        def answer(received: Any, _: Any) -> Any:
            if isinstance(received.request, Describe):
                address = Address("robot", "arm-1", "1")
                return Described(robot=RobotDescription(address=address, kinds=("Arm", "Robot")))
            self.asked.append((received.request, received.principal))
            return reply or Done(note="moved")

        here = Here("robot", "arm-1", self.member.gate, lambda: ("Arm", "Robot"))
        dispatcher = Dispatcher("arm-1", answer, now=loop.time, here=here)
        await self.member.serve(ROBOT, dispatcher.take)
        await self.member.announce(ROBOT)

    async def close(self) -> None:
        await self.gateway.close()
        await self.member.close()
        await self.gate.close()


async def ask(
    site: SiteOfTest, request: Any, *, key: str = ROBOT, within: float = 3.0, sender: str = ""
) -> Any:
    """Ask, and return the last reply; None: there was none."""
    sealed = seal(request, now=asyncio.get_running_loop().time(), within=within, sender=sender)
    replies: list[bytes] = []
    over = asyncio.Event()
    loop = asyncio.get_running_loop()

    def on_reply(body: bytes | None) -> None:
        loop.call_soon_threadsafe(over.set if body is None else lambda: replies.append(body))

    site.member.ask(key, sealed.body, void_at=sealed.void_at, on_reply=on_reply)
    async with asyncio.timeout(15):
        await over.wait()
    found = decode_reply(replies[-1], key=key) if replies else None
    return found.revive() if isinstance(found, Raised) else found


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


def keys_of(place: Path, *members: tuple[str, MemberKind]) -> list[RealmKeys]:
    """The keys of lab, where the realm was made, and of the members."""
    found = [create(place / "k0" / "keys", "plant", "lab", (), now=WALL)]
    for number, (name, kind) in enumerate(members, 1):
        invitation = read_token(token_of(found[0].invite(name, kind, now=WALL)), WALL)
        key = Realm(seed=number).key()
        certificate = found[0].admit(request_to_join(invitation, key), WALL)
        found.append(join_realm_keys(place / f"k{number}" / "keys", invitation, key, certificate, now=WALL))
    return found


@contextlib.asynccontextmanager
async def linked(
    place: Path, hub: MemoryHub, *members: tuple[str, MemberKind]
) -> AsyncIterator[list[SiteOfTest]]:
    """Lab and its members, linked; the robot is at the first of them."""
    found = [SiteOfTest(place / f"m-{keys.name}", hub, keys) for keys in keys_of(place, *members)]
    for site in found:
        await site.open()
    await found[1].be_robot()
    await until(lambda: all(site.member.presence.there(ROBOT) for site in found))
    yield found
    for site in found:
        await site.close()


@pytest.fixture
async def sites(place: Path, hub: MemoryHub) -> AsyncIterator[list[SiteOfTest]]:
    """Three sites that are linked; the robot is at the second one."""
    async with linked(place, hub, ("hall", "site"), ("yard", "site")) as found:
        yield found


def call(key: str = "k1") -> Call:
    return Call(key=key, command="move", deadline=5.0)
