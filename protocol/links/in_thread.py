"""Opening what may take its time: an adapter, a bus. Whoever waits for it may be told to stop waiting."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


async def opened(open_it: Callable[[], T], close: Callable[[T], object]) -> T:
    """Open something in a thread.

    No thread can be stopped. So who is cancelled meanwhile waits on until it has ended, and closes what
    nobody will own; otherwise it would stay open, held by nobody and in everybody's way.

    Args:
        open_it: may block; what it raises is raised here.
        close: what to do with what was opened for nobody; may block.
    """
    loop = asyncio.get_running_loop()
    opening = loop.run_in_executor(None, open_it)
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:
        await asyncio.wait([opening])
        if opening.exception() is None:
            await loop.run_in_executor(None, close, opening.result())
        raise
