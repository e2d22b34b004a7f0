"""Joining a realm: the one place where the supervisor opens a transport."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotree.tui.fleet_contract import FleetDoor

DEFAULT = "default"


def chosen(given: str) -> str:
    """Return the realm that was asked for, else that of the environment, else the default one."""
    return given or os.environ.get("ROBOTREE_REALM", "") or DEFAULT


@contextlib.asynccontextmanager
async def joined(realm: str) -> AsyncIterator[FleetDoor]:
    """Join a realm and see its fleet; leave when the block ends.

    Raises:
        TransportError: the realm cannot be joined.
    """
    from robotree.vr.fleet import Fleet
    from robotree.vr.host.zenoh import join

    transport = await join(realm)
    try:
        fleet = Fleet(transport)
        await fleet.start()
        try:
            yield fleet
        finally:
            await fleet.close()
    finally:
        await transport.close()
