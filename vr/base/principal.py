"""The principal of a request: the person, program or robot that asks.

The kernel names the process that has sent a request and its user (SO_PEERCRED, unix(7)); nobody can be
somebody else. What the process says beyond that, it answers for: which of its robots or programs asks, and at
which terminal the person sits.

For who asks from another machine the gateway of this one answers (`Voucher`): that machine has proved to it
which member of the realm it is, and its kernel has named the process and the user there.
"""

from __future__ import annotations

import os
import re
from functools import cache, lru_cache
from typing import NamedTuple

import msgspec

SCRIPT = "script"
"""Instead of a terminal, where a person's program has none."""

ASSISTANTS = "mcp"
"""Instead of a terminal `mcp/NAME`: an assistant asks, a model with a key (`robotree assistant invite`)."""

NOBODY = "?"
"""Instead of the name of an assistant: no policy can name it."""

_TERMINAL = re.compile(r"[\w/.-]{1,32}")


class Credentials(NamedTuple):
    """A process, as the kernel names it."""

    process: int
    user: int


class Principal(msgspec.Struct, frozen=True, omit_defaults=True):
    """The asker of a request. Requests of the same robot, or of the same program, have equal principals."""

    user: str = ""
    """Name of the system's user; empty: the robot itself, see `ITSELF`."""
    process: int = 0
    """Its number on this machine."""
    agent: str = ""
    """Key under which the asker is present: of a robot, or of a person's program; empty: it is under none."""
    terminal: str = ""
    """At which the person sits for whom it is asked; empty: it is asked for no person, but for a robot."""
    site: str = ""
    """The member of the realm from whose machine it was asked; empty: from this one."""
    member: bool = False
    """Whether that member is a person, and `user` its name."""
    roles: tuple[str, ...] = ()
    """In the key of that member: `realm invite --may`."""

    @property
    def person(self) -> str:
        """Name of who asks, `anna@pts/3`, `anna@lab` from a site, `claude@mcp`; empty: it is a robot."""
        if assistant := self.assistant:
            return f"{assistant}@{self.site}/{ASSISTANTS}" if self.site else f"{assistant}@{ASSISTANTS}"
        return f"{self.user}@{self.site or self.terminal}" if self.terminal else ""

    @property
    def is_robot(self) -> bool:
        """Whether a robot asks, for no person."""
        return not self.terminal and self.agent.startswith("robot/")

    @property
    def assistant(self) -> str:
        """Name of the assistant who asks, for whom the process of `user` answers; empty: none asks."""
        return self.terminal[len(ASSISTANTS) + 1 :] if self.terminal.startswith(f"{ASSISTANTS}/") else ""


class Voucher(msgspec.Struct, frozen=True, array_like=True):
    """For whom the gateway of this machine answers, in the envelope of a request from another one.

    Any process of this user could write one, as it could write under which terminal a person sits: on one
    machine a user is trusted with its own processes. Of other users none is believed.
    """

    site: str
    """The member of the realm, proved by its key."""
    user: str
    """On its machine, as the kernel there says; of a person's machine: that person."""
    process: int
    """Its number there."""
    member: bool = False
    """Whether the member is a person."""
    roles: tuple[str, ...] = ()
    """In its key."""


_voucher = msgspec.msgpack.Decoder(Voucher)


ITSELF = Principal()
"""The robot itself: its own code, its watchdog, and what its process notices. No request has this one."""


@lru_cache(1024)
def principal_of(sender: Credentials, agent: str, terminal: str) -> Principal:
    """Return the principal of a request.

    Args:
        sender: the process, as the kernel names it.
        agent: as the process says.
        terminal: as the process says; one that cannot be a terminal counts as `SCRIPT`.
    """
    return Principal(user_name(sender.user), sender.process, agent, _readable(terminal))


@lru_cache(1024)
def vouched(proof: bytes, agent: str, terminal: str) -> Principal:
    """Return the principal of a request for which the gateway answers.

    Args:
        proof: a `Voucher`, packed.
        agent: key of the asker; the gateway has seen that it is present at that site.
        terminal: as the process there says.

    Raises:
        msgspec.MsgspecError: it is no voucher.
    """
    voucher = _voucher.decode(proof)
    return Principal(
        voucher.user, voucher.process, agent, _readable(terminal), voucher.site, voucher.member, voucher.roles
    )


def _readable(terminal: str) -> str:
    """Return a terminal as it is believed: an assistant whose name cannot be one never counts as a person."""
    if not terminal or _TERMINAL.fullmatch(terminal):
        return terminal
    return f"{ASSISTANTS}/{NOBODY}" if terminal.startswith(f"{ASSISTANTS}/") else SCRIPT


@cache
def user_name(user: int) -> str:
    """Return the name of a user of the system; a user without a name has its number."""
    import pwd  # only those who are asked need it

    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)


def this_process() -> Credentials:
    """Return what the kernel tells others of this process."""
    return Credentials(os.getpid(), os.geteuid())


def is_person(caller: str) -> bool:
    """Whether the name of a caller is that of a person: no robot's name has an @."""
    return "@" in caller
