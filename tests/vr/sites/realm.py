"""A realm for tests: its authority, and members who know it."""

from __future__ import annotations

import random
from collections.abc import Callable

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr.sites.certificates import Authority, MemberKind, Trust
from robotree.vr.sites.handshake import Handshakes, Own

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
