"""A program that takes an entry under a transaction, says so, and never ends: to be killed.

python -m tests.vr.space.taker SPACE
"""

from __future__ import annotations

import asyncio
import sys

from robotree.vr.base.requests import EntriesFound, FindEntries, OpenTransaction, TransactionOpened
from robotree.vr.exchange.asking import ask
from robotree.vr.network.local import join

KEY = "caller/taker"


async def take(space: str) -> None:
    """Take, and wait for the end."""
    transport = await join()
    await transport.announce(KEY)
    assert await transport.presence.until(f"space/{space}/*", there=True, within=10)
    (key,) = transport.presence.keys(f"space/{space}/*")
    opened = await ask(transport, key, OpenTransaction(term=600.0), TransactionOpened, timeout=10, sender=KEY)
    request = FindEntries(kind="Job", take=True, transaction=opened.transaction)
    found = await ask(transport, key, request, EntriesFound, timeout=10, sender=KEY)
    sys.stdout.write(f"{len(found.entries)}\n")
    sys.stdout.flush()
    await asyncio.get_running_loop().create_future()


asyncio.run(take(sys.argv[1]))
