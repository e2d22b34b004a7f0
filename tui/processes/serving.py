"""A process that is one agent: starts, prints `ready ADDRESS`, and ends on a signal or when its starter ends.

`--tether` is for starters: the agent holds the read end of a pipe as its standard input and ends when the
pipe closes, so that no agent outlives the program that started it, even one that was killed. A service
manager that waits for the agent is told, too, as sd_notify(3) says.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

from robotree.tui.processes.ending import LAST_WORDS, Ending
from robotree.tui.processes.guard import guarded
from robotree.tui.terminal import put

if TYPE_CHECKING:
    from robotree.vr.agents.run import Ready

RunAgent = Callable[["Ready"], Coroutine[Any, Any, None]]
"""Is an agent until it is cancelled."""

STDOUT, STDERR = 1, 2
"""File descriptors."""
MANAGER = "NOTIFY_SOCKET"
"""Names the socket on which a service manager waits (`Type=notify`); with @ first it has no file."""


async def serve(run: RunAgent, *, tether: bool, foreign: bool) -> None:
    """Be an agent until a signal asks for the end, or the end of the tether does.

    Args:
        run: brings the agent up, and down when it is cancelled. What it raises comes out of here.
        tether: also end when standard input ends.
        foreign: whether authors' code runs in it, which may hold the interpreter: then a guard ends it.
    """
    being = asyncio.ensure_future(run(_up))
    with contextlib.ExitStack() as stack, contextlib.suppress(asyncio.CancelledError):
        if foreign:
            stack.enter_context(guarded(tether=tether))
        ending = stack.enter_context(Ending(being.cancel, LAST_WORDS))
        ending.at(signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if tether:
            ending.with_input()
        await being


def _up(address: str) -> None:
    """Say that the agent is up. That was the result; whatever is printed from now on is a log.

    A starter reads standard output as far as this line: an author's `print` would fill the pipe, and block.
    """
    put(f"ready {address}")
    os.dup2(STDERR, STDOUT)
    tell_the_manager()


def tell_the_manager() -> None:
    """Tell the service manager that this process is up, once: what it starts is no service."""
    path = os.environ.pop(MANAGER, "")
    if not path:
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.connect("\0" + path[1:] if path[0] == "@" else path)
        manager.send(b"READY=1")
