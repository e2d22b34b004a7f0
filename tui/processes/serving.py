"""A process that is one agent: up, `ready ADDRESS`, and down again when it is told or its starter ends.

`--tether` is for starters: the agent holds the read end of a pipe as its standard input and ends when the
pipe closes, so that no agent outlives the program that started it, even one that was killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import threading
from collections.abc import Callable, Coroutine
from typing import Any

from robotree.tui.terminal import put

Ready = Callable[[str], None]
"""To be told the agent's address once it is up."""

Run = Callable[[Ready], Coroutine[Any, Any, None]]
"""Is an agent until it is cancelled."""

STDIN, STDOUT, STDERR = 0, 1, 2
"""File descriptors."""

LAST_WORDS = 3.0
"""[s] allowed for the polite end before the process is ended anyway."""


async def serve(run: Run, *, tether: bool) -> None:
    """Be an agent until SIGINT, SIGTERM, or the end of the tether.

    Args:
        run: brings the agent up, and down when it is cancelled. What it raises comes out of here.
        tether: also end when standard input ends.
    """
    loop = asyncio.get_running_loop()
    being = asyncio.ensure_future(run(_up))

    def end() -> None:
        being.cancel()

    for one in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(one, end)
    if tether:
        hold(loop, end)
    with contextlib.suppress(asyncio.CancelledError):
        await being


def _up(address: str) -> None:
    """Say that the agent is up. That was the result; whatever is printed from now on is a log.

    A starter reads standard output as far as this line: an author's `print` would fill the pipe, and block.
    """
    put(f"ready {address}")
    os.dup2(STDERR, STDOUT)


def hold(loop: asyncio.AbstractEventLoop, let_go: Callable[[], None]) -> None:
    """Call back on the loop when standard input ends.

    A thread reads, because standard input may be anything, also what an event loop cannot wait for. Should
    the loop hang then, the process is ended all the same: no orphan stays behind. It reads beneath Python's
    buffer, whose lock an interpreter that shuts down meanwhile could not take from it.
    """

    def wait() -> None:
        with contextlib.suppress(OSError):
            while os.read(STDIN, 64):
                pass
        last = threading.Timer(LAST_WORDS, os._exit, args=(1,))
        last.daemon = True
        last.start()
        with contextlib.suppress(RuntimeError):  # the loop has ended already
            loop.call_soon_threadsafe(let_go)

    threading.Thread(target=wait, name="tether", daemon=True).start()
