"""Both ends of links over CAN, which close with the block that they are in."""

from __future__ import annotations

from collections.abc import AsyncIterator
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
