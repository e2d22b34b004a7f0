"""Joining a realm: the one place where the supervisor opens a transport."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncGenerator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotree.vr.supervision.fleet import Fleet


def chosen(given: str) -> str:
    """Return the realm that was asked for, else that of the environment, else the default one.

    Raises:
        BadName: it cannot be a name.
    """
    from robotree.vr.network.rendezvous import realm_name

    return realm_name(given or None)


READONLY_VARIABLE = "ROBOTREE_READONLY"
_NO = {"", "0", "no", "off", "false"}


def only_looking(*, given: bool) -> bool:
    """Whether what changes robots shall be absent: `--readonly` was given, or the environment says so."""
    return given or os.environ.get(READONLY_VARIABLE, "").strip().lower() not in _NO


def anybody_met(realm: str) -> bool:
    """Whether anybody is in a realm or has been: joining it would make its folder where nobody has."""
    from robotree.vr.network.rendezvous import met

    return met(realm)


@contextlib.asynccontextmanager
async def joined(realm: str, *, looking: bool = True) -> AsyncGenerator[Fleet]:
    """Join a realm and see its fleet; leave when the block ends.

    Args:
        realm: its name.
        looking: wait for the lookup services. A stop is given without that.

    Raises:
        TransportError: the realm cannot be joined.
    """
    from robotree.vr.network.local import join
    from robotree.vr.supervision.fleet import Fleet

    transport = await join(realm)
    try:
        fleet = Fleet(transport)
        if looking:
            await fleet.start()
        try:
            yield fleet
        finally:
            await fleet.close()
    finally:
        await transport.close()
