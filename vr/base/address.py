"""Names and addresses of agents.

Three things are kept apart:

* The *identity* of an agent is its role and its name. Bonds name identities, and are fenced by epochs.
* An *incarnation* is one life of it: a robot that is deleted and made again under its old name is another
  one. Requests and presence go to an incarnation (`Address.key`), so that nobody talks by mistake to one
  that never granted the right.
* The *location*, which process an incarnation lives in, is written nowhere: the transport looks it up by key.

In a realm that several users of one machine share, every user could announce the key of another one's robot,
and be given its orders. So the last part of a key, which its agent's process draws, ends there with the
number of its user (`0123456789abcdefu1000`). The kernel says whose process announces a key: `Mesh` believes
no other user than the one whose number is in it. A realm that its user has alone has no such ends.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final, Literal

import msgspec

from robotree.vr.base.chance import token
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


def parted(name: str) -> tuple[str, str]:
    """Return the site and the name of an agent as people write it: `hall:arm-1`; without a site "".

    Raises:
        BadName: one of the two cannot be a name.
    """
    site, colon, plain = name.rpartition(":")
    if not _NAME.fullmatch(plain) or (colon and not _NAME.fullmatch(site)):
        raise BadName(name=name)
    return site, plain


class Address(msgspec.Struct, frozen=True, order=True):
    """One incarnation of an agent, in any process.

    Where several sites have agents of one name, people are shown addresses whose names begin with the site,
    `hall:arm-1` (`shown`). Such an address has the same key.
    """

    role: Role
    name: str
    incarnation: str
    """Opaque, unique in the realm for ever; made by the creator of the agent."""

    @property
    def identity(self) -> str:
        """The agent in all its incarnations: `robot/arm-1`."""
        return f"{self.role}/{self.plain_name}"

    @property
    def plain_name(self) -> str:
        """The name without a site."""
        return self.name.rpartition(":")[2]

    @property
    def key(self) -> str:
        """The key under which it announces its presence and serves its requests."""
        name = self.name
        return f"{self.role}/{name.rpartition(':')[2] if ':' in name else name}/{self.incarnation}"

    def shown(self, site: str) -> Address:
        """Return it as people are shown it where several sites have an agent of its name."""
        return Address(self.role, f"{site}:{self.plain_name}", self.incarnation)

    @classmethod
    def parse(cls, key: str) -> Address | None:
        """Read a key, or return None when it is not an agent's. Keys come from a network: never raises."""
        return _parsed(key)


def shown_address(key: str) -> Address | None:
    """Read a key in which the name may begin with a site, as people are shown it; None: it is no agent's."""
    role, _, rest = key.partition("/")
    site, colon, plain = rest.partition(":")
    if not colon:
        return _parsed(key)
    address = _parsed(f"{role}/{plain}")
    return None if address is None or not _NAME.fullmatch(site) else address.shown(site)


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


_MARKED: Final = re.compile(r"(?:caller|[a-z]+/[A-Za-z0-9][A-Za-z0-9_-]{0,63})/[^/]*u(\d{1,10})(?:/.*)?")
"""A key, or that of a sample, which begins with its agent's."""

_mark = ""


def mark(user: int | None) -> None:
    """Have all keys that this process draws from now on end with the number of a user; None: with none."""
    global _mark  # noqa: PLW0603 # a process has one user
    _mark = "" if user is None else f"u{user}"


def unique() -> str:
    """Draw the last part of a key that nobody ever had."""
    return token() + _mark


def user_of(key: str) -> int | None:
    """Return the number of the user whose agent a key names; None: it names none."""
    found = _MARKED.fullmatch(key)
    return None if found is None else int(found[1])
