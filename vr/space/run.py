"""A space as a process: up until it is cancelled, and then down in order."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from robotree.vr.base.address import check_name
from robotree.vr.network.local import join
from robotree.vr.space.service import SpaceService
from robotree.vr.space.store import Durability, MemoryStore, SpaceStore

MEMORY = "memory"
"""Instead of a file or a URL: nothing is kept."""
POSTGRES = ("postgresql://", "postgres://")
"""The beginnings of URLs of PostgreSQL (libpq)."""


async def run_space(
    name: str,
    store: str,
    *,
    durability: Durability = "process",
    realm: str | None = None,
    ready: Callable[[str], None] = lambda _: None,
) -> None:
    """Be a space in a realm until cancelled.

    Args:
        name: of the space, unique in the realm.
        store: `memory`, a SQLite file, or the URL of a database of PostgreSQL.
        durability: what an answered request survives: `process` or `power`.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        ready: told the key once it answers.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living space has the name.
        SpaceError: the store cannot be used.
        TransportError: the realm cannot be joined.
    """
    check_name(name)
    async with contextlib.AsyncExitStack() as stack:
        opened = await asyncio.to_thread(open_store, name, store, durability)
        stack.callback(opened.close)
        transport = await join(realm)
        stack.push_async_callback(transport.close)
        service = SpaceService(transport, name, opened)
        stack.push_async_callback(service.close)
        await service.start()
        ready(service.address.key)
        await asyncio.get_running_loop().create_future()


def open_store(name: str, store: str, durability: Durability) -> SpaceStore:
    """Open the store of a space, see `run_space`; only what it needs is imported.

    Raises:
        SpaceError: it cannot be used.
    """
    if store == MEMORY:
        return MemoryStore(name, time.monotonic)
    if store.startswith(POSTGRES):
        from robotree.vr.space.postgres import PostgresStore

        return PostgresStore(name, store, durability=durability)
    from robotree.vr.space.sqlite import SqliteStore

    return SqliteStore(name, Path(store), time.monotonic, time.time, durability=durability)
