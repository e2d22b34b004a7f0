"""Names are unique at a site: of two agents that come at once under one name only one stays.

At another site there may be the same name: sites meet after their robots were named, and a robot must come
back under its name whatever others are called.

Presence decides, not the lookup services, for those are soft and know no enslaved robots
(docs/decisions/0003). Robots and views have their names in common, since people see them side by side, in one
list and one log; hosts and lookup services have their own.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Coroutine
from typing import Any

from robotree.vr.base.address import Address, Role, check_name, everyone, unique
from robotree.vr.base.errors import DuplicateName, NameInSilence
from robotree.vr.base.places import here_of
from robotree.vr.base.transport import Occupied, Registration, Transport

SETTLE = 0.1
"""[s] after which an announcement has reached all others that live and answer, and its end too."""
_SIDE_BY_SIDE: tuple[Role, ...] = ("robot", "view")


class Declarations(contextlib.AsyncExitStack):
    """What an agent has declared to others, and what it does meanwhile: what came last is taken back first.

    An agent fills one while it starts and keeps it (`pop_all`) when that has succeeded. Closing it twice is
    once.
    """

    async def keep(self, declaring: Awaitable[Registration]) -> None:
        """Declare something."""
        self.push_async_callback((await declaring).close)

    def work(self, work: Coroutine[Any, Any, None], name: str) -> None:
        """Do something until the end."""
        task = asyncio.create_task(work, name=name)

        async def end() -> None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

        self.push_async_callback(end)


def new_address(role: Role, name: str) -> Address:
    """Return an address that nobody ever had.

    Raises:
        BadName: the name cannot be one.
    """
    return Address(role, check_name(name), unique())


async def claim(transport: Transport, address: Address) -> Registration:
    """Announce an agent under a name that it alone has.

    Args:
        transport: the way to all who could have it.
        address: of the agent, which must already serve its requests: others ask it as soon as they see it.

    Returns:
        The presence, to be closed when the agent ends.

    Raises:
        DuplicateName: a living agent has the name.
        NameInSilence: one has it that lives and hangs.
    """
    presence: Registration | None = None
    while presence is None:
        await expect_free(transport, address)
        with contextlib.suppress(Occupied):  # another one came meanwhile: look once more
            presence = await transport.announce(address.key, unless=_patterns(address))
    try:
        await outlast(transport, address)
    except BaseException:
        await presence.close()
        raise
    return presence


async def expect_free(transport: Transport, address: Address) -> None:
    """Before announcing: check that no other agent has the name; one that is just ending is waited for.

    Raises:
        DuplicateName: another agent has it.
        NameInSilence: another agent has it, and its process hangs.
    """
    presence = transport.presence
    for pattern in _patterns(address):
        hanging = await presence.hanging(pattern)
        gateways = {one.where for one in presence.held(everyone("gateway"))} if hanging else set[str]()
        for one in hanging:
            # of a process that was deposed, which ends when it wakes, or at another site
            if one.key == address.key or one.where in gateways:
                continue
            role = one.key.partition("/")[0]
            raise NameInSilence(role=role, name=address.name, where=one.in_words, remedy=one.remedy)
        await presence.until(pattern, there=False, within=SETTLE)
    for other in _others(transport, address):
        raise DuplicateName(role=other.role, name=other.name)


async def outlast(transport: Transport, address: Address) -> None:
    """After announcing: see that of those who came at the same moment this one stays.

    Raises:
        DuplicateName: another one stays, because its address is smaller.
    """
    await transport.settle(SETTLE)
    for other in _others(transport, address):
        if other < address:
            raise DuplicateName(role=other.role, name=other.name)


def _others(transport: Transport, address: Address) -> list[Address]:
    keys = [key for pattern in _patterns(address) for key in transport.presence.keys(pattern)]
    here = keys and here_of(transport.presence, keys)
    found = map(Address.parse, here)
    return [other for other in found if other is not None and other != address]


def _patterns(address: Address) -> list[str]:
    roles = _SIDE_BY_SIDE if address.role in _SIDE_BY_SIDE else (address.role,)
    return [everyone(role, address.name) for role in roles]
