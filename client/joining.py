"""Entering a realm and leaving it: the one place where a supervisor or a program opens a transport."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncGenerator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotree.vr.supervision.fleet import Fleet


@contextlib.asynccontextmanager
async def joined(realm: str) -> AsyncGenerator[Fleet]:
    """Join a realm and see its fleet; leave when the block ends.

    Args:
        realm: its name.

    Raises:
        TransportError: the realm cannot be joined.
    """
    from robotree.vr.base.envelope import sitting_at, this_terminal
    from robotree.vr.network.local import join
    from robotree.vr.supervision.fleet import Fleet

    with sitting_at(this_terminal()):
        transport = await join(realm)
        try:
            fleet = Fleet(transport, realm)
            await fleet.start()
            try:
                yield fleet
            finally:
                await fleet.close()
        finally:
            await transport.close()
