"""Names and addresses of agents.

Three things are kept apart:

* The *identity* of an agent is its role and its name. Bonds name identities, and are fenced by epochs.
* An *incarnation* is one life of it: a robot that is deleted and made again under its old name is another
  one. Requests and presence go to an incarnation (`Address.key`), so that nobody talks by mistake to one
  that never granted the right.
* The *location*, which process an incarnation lives in, is written nowhere: the transport looks it up by key.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Literal

import msgspec

from robotree.vr.base.errors import BadName

Role = Literal["robot", "view", "host", "lookup", "space", "directory", "gateway"]
ROLES: tuple[Role, ...] = ("robot", "view", "host", "lookup", "space", "directory", "gateway")

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def check_name(name: str) -> str:
    """Return the name, if it can be one.

    Raises:
        BadName: it is empty, too long or has characters that would break an address or a dotted path.
    """
    if not _NAME.fullmatch(name):
        raise BadName(name=name)
    return name


class Address(msgspec.Struct, frozen=True, order=True):
    """One incarnation of an agent, in any process."""

    role: Role
    name: str
    incarnation: str
    """Opaque, unique in the realm for ever; made by the creator of the agent."""

    @property
    def identity(self) -> str:
        """The agent in all its incarnations: `robot/arm-1`."""
        return f"{self.role}/{self.name}"

    @property
    def key(self) -> str:
        """The key under which it announces its presence and serves its requests."""
        return f"{self.role}/{self.name}/{self.incarnation}"

    @classmethod
    def parse(cls, key: str) -> Address | None:
        """Read a key, or return None when it is not an agent's. Keys come from a network: never raises."""
        return _parsed(key)


@lru_cache(4096)
def _parsed(key: str) -> Address | None:
    """As `Address.parse`; samples of the same robots come again and again."""
    parts = key.split("/")
    if len(parts) != len(Address.__struct_fields__) or parts[0] not in ROLES or not _NAME.fullmatch(parts[1]):
        return None
    return Address(parts[0], parts[1], parts[2])  # pyright: ignore[reportArgumentType] # just checked


def everyone(role: Role, name: str = "*") -> str:
    """Return the presence pattern of all incarnations of a role, or of those with one name."""
    return f"{role}/{name}/*"
