"""A directory as a process: up until it is cancelled, and then down in order."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, cast

from robotree.vr.base.address import check_name
from robotree.vr.base.chance import token
from robotree.vr.base.errors import DirectoryUnusable, JournalError
from robotree.vr.base.order import OrderHold
from robotree.vr.journal.store import own
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore

if TYPE_CHECKING:
    from robotree.vr.journal.postgres import PostgresLog

FILE = "directory.db"
"""File with the memory of a directory, in its folder."""
STOP = "stop"
"""File in that folder: a stop that came while the directory was away."""


async def run_directory(
    name: str,
    folder: Path,
    *,
    realm: str | None = None,
    site: str = "",
    database: str = "",
    ready: Callable[[str], None] = lambda _: None,
) -> None:
    """Be a directory in a realm until cancelled: a lookup service with a durable memory.

    Args:
        name: of the directory and of its lookup service, unique in the realm.
        folder: with its memory.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        site: name of this machine in a realm of several; empty: there is one machine.
        database: of PostgreSQL, in which its memory is instead of the folder: `postgresql://host/database`.
        ready: told the key once it answers.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living directory or lookup service has the name.
        OrderError: its memory cannot be used.
        TransportError: the realm cannot be joined.
    """
    check_name(name)
    async with contextlib.AsyncExitStack() as stack:
        log = await asyncio.to_thread(_taken, database, f"{realm or ''}/directory/{name}", name, stack)
        store = await asyncio.to_thread(OrderStore, folder / FILE, log)
        stack.callback(store.close)
        transport = await join(realm)
        stack.push_async_callback(transport.close)
        lookup = LookupService(transport, name)
        stack.push_async_callback(lookup.close)
        service = DirectoryService(transport, name, store, site=site)
        stack.push_async_callback(service.close)
        take_stop(service, folder)
        await lookup.start()
        await service.start()
        ready(service.address.key)
        await asyncio.get_running_loop().create_future()


def _taken(url: str, log: str, name: str, stack: contextlib.AsyncExitStack) -> PostgresLog | None:
    """Become the owner of a directory's part of a database; `stack` lets it go. None: there is none.

    Raises:
        DirectoryUnusable: another process has it, or the database cannot be used.
    """
    if not url:
        return None
    from robotree.vr.journal.postgres import PostgresPlace

    place = PostgresPlace(url, log)
    stack.callback(place.close)
    try:
        found = own(place, name)
    except (JournalError, OSError) as error:
        raise DirectoryUnusable(where=place.where, reason=str(error)) from None
    stack.callback(found.close)
    return cast("PostgresLog", found)


def leave_stop(folder: Path, by: str) -> None:
    """Have a directory that is away hold all robots when it is back.

    Args:
        folder: with its memory.
        by: who stops, for people.

    Raises:
        OSError: it cannot be left.
    """
    from robotree.files import replace

    replace(folder / STOP, by.encode())


def take_stop(service: DirectoryService, folder: Path) -> None:
    """OrderHold all robots if a stop was left, before anybody can fetch an order."""
    path = folder / STOP
    if path.exists():
        by = path.read_text(errors="replace")[:100]
        hold = OrderHold(id=token(), by=by, at=service.book.unix())
        service.book.keep(holds=[hold])
        path.unlink(missing_ok=True)
