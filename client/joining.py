"""Entering a realm and leaving it: the one place where a supervisor or a program opens a transport."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncGenerator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient


@contextlib.asynccontextmanager
async def joined(realm: str) -> AsyncGenerator[RealmClient]:
    """Join a realm and see its robots; leave when the block ends.

    Args:
        realm: its name.

    Raises:
        TransportError: the realm cannot be joined.
    """
    from robotree.vr.base.envelope import sitting_at, this_terminal
    from robotree.vr.network.local import join
    from robotree.vr.supervision.realm_client import RealmClient

    with sitting_at(this_terminal()):
        transport = await join(realm)
        try:
            realm_client = RealmClient(transport, realm)
            await realm_client.start()
            try:
                yield realm_client
            finally:
                await realm_client.close()
        finally:
            await transport.close()
