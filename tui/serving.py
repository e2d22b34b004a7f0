"""A process that is one agent: up, `ready ADDRESS`, and down again when it is told or its starter ends.

`--tether` is for starters: the agent holds the read end of a pipe as its standard input and ends when the
pipe closes, so that no agent outlives the program that started it, even one that was killed.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager

from robotree.tui.terminal import put

Running = AbstractAsyncContextManager[str]
"""Inside its block an agent is up; its value is the agent's address."""

LAST_WORDS = 3.0
"""[s] allowed for the polite end before the process is ended anyway."""


async def serve(running: Running, *, tether: bool) -> None:
    """Run an agent until SIGINT, SIGTERM, or the end of the tether.

    Args:
        running: brings the agent up and down.
        tether: also end when standard input ends.
    """
    over = asyncio.Event()
    loop = asyncio.get_running_loop()
    for one in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(one, over.set)
    if tether:
        hold(loop, over.set)
    async with running as address:
        put(f"ready {address}")
        await over.wait()


def hold(loop: asyncio.AbstractEventLoop, let_go: Callable[[], None]) -> None:
    """Call back on the loop when standard input ends.

    A thread reads, because standard input may be anything, also what an event loop cannot wait for. Should
    the loop hang then, the process is ended all the same: no orphan stays behind.
    """

    def wait() -> None:
        while sys.stdin.buffer.read(1):
            pass
        loop.call_soon_threadsafe(let_go)
        threading.Timer(LAST_WORDS, _abandon).start()

    threading.Thread(target=wait, name="tether", daemon=True).start()


def _abandon() -> None:
    import os

    os._exit(1)
