"""`Transport.ask` and direct handlers for transports whose requests all go by the event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

from robotree.vr.errors import VrError
from robotree.vr.transport import DirectHandler, Hear, RequestHandler, Respond

FOREVER = 7 * 24 * 3600.0
"""[s] for replies for which the asker sets no limit."""


async def relay(replies: AsyncIterator[bytes], hear: Hear) -> None:
    """Hand on the replies to a request as `Transport.ask` does."""
    with contextlib.suppress(VrError):
        async for reply in replies:
            hear(reply)
    hear(None)


def directly(direct: DirectHandler, handler: RequestHandler) -> RequestHandler:
    """Return a handler that offers each request to a direct one first."""

    async def handle(body: bytes, respond: Respond) -> None:
        loop, over = asyncio.get_running_loop(), asyncio.Event()

        def soon(action: Respond, reply: bytes) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody waits
                loop.call_soon_threadsafe(action, reply)

        if direct(body, lambda reply: soon(respond, reply), lambda: soon(lambda _: over.set(), b"")):
            await over.wait()
        else:
            await handler(body, respond)

    return handle
