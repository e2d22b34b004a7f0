"""Both ends of links over CAN, which close with the block that they are in."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from robotree.protocol.links.can import CanAddress, CanLink, CanListener, connect, listen
from robotree.protocol.links.link import Accept


@asynccontextmanager
async def listening(address: CanAddress, accept: Accept) -> AsyncIterator[CanListener]:
    listener = await listen(address, accept)
    try:
        yield listener
    finally:
        await listener.close()


@asynccontextmanager
async def connected(address: CanAddress, accept: Accept) -> AsyncIterator[CanLink]:
    link = await connect(address, accept)
    try:
        yield link
    finally:
        link.close()


def wait_for(condition: Callable[[], object]) -> None:
    """Wait until something holds that no event reports."""
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
