"""A realm in virtual time whose robots keep to a policy, and persons who ask them."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest

from robotree.vr.base.envelope import Envelope, this_clock
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import Voucher, user_name
from robotree.vr.base.requests import AnyRequest, Raised, Reply, decode_reply
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from tests.vr.core.conftest import Realm, pytest_asyncio_loop_factories, units

__all__ = ["pytest_asyncio_loop_factories", "units"]

ME = user_name(os.geteuid())


class PoliticalRealm(Realm):
    """A realm with a policy."""

    def __init__(self, network: MemoryNetwork) -> None:
        network.gate = PolicyGate()
        super().__init__(network)
        self.gate = network.gate

    def rule(self, text: str) -> None:
        """Put a policy in force."""
        self.gate.policy = read_policy(f"realm: test\nversion: 1\n{text}")

    async def ask_as(
        self, person: str, key: str, request: AnyRequest, *, sender: str = "", terminal: str = "pts/1"
    ) -> Reply:
        """Ask for somebody at another site, or for a person with a key of their own, as a gateway does."""
        return await ask_as(self.operator, person, key, request, sender=sender, terminal=terminal)


async def ask_as(
    transport: MemoryTransport,
    person: str,
    key: str,
    request: AnyRequest,
    *,
    sender: str = "",
    terminal: str = "pts/1",
) -> Reply:
    """Ask over a member of the network; see `PoliticalRealm.ask_as`."""
    name, _, site = person.partition("@")
    proof = msgspec.msgpack.encode(Voucher(site or name, name, 7, member=not site))
    envelope = Envelope(request, sender, transport.loop.time(), 5.0, this_clock(), proof, terminal)
    async for reply in transport.request(key, msgspec.msgpack.encode(envelope), timeout=5.0):
        found = decode_reply(reply, key=key)
        if isinstance(found, Raised):
            raise found.revive()
        return found
    raise AssertionError("no answer")


@pytest.fixture
async def realm() -> AsyncIterator[Any]:
    realm = PoliticalRealm(MemoryNetwork(delay=0.001))
    await realm.open()
    yield realm
    realm.gate.policy, realm.gate.trouble = None, ""
    await realm.close()


@pytest.fixture
async def realm_client(realm: Any) -> AsyncIterator[RealmClient]:
    found = RealmClient(realm.network.join("supervisor"))
    await found.start()
    yield found
    await found.close()
