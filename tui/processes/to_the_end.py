"""A program that works on an event loop to its end, whoever ends it."""

from __future__ import annotations

import asyncio
import select
import signal
import socket
from collections.abc import Coroutine
from typing import Any

from robotree.tui import exit_codes
from robotree.tui.errors import Interrupted
from robotree.tui.processes.ending import CREW_LAST_WORDS, Ending
from robotree.tui.terminal import complain, forget_the_reader, until_the_reader_leaves


def to_the_end(work: Coroutine[Any, Any, int], *, listening: bool = False, on_screen: bool = False) -> int:
    """Run to the end. SIGTERM and SIGHUP end it as Ctrl-C does: what it began on robots ends too.

    Args:
        work: what is done.
        listening: it does nothing but tell, and so ends when nobody reads it any more.
        on_screen: it is for the person at the terminal, and so ends when the terminal closes.
    """

    async def obeying() -> int:
        loop, task = asyncio.get_running_loop(), asyncio.ensure_future(work)

        def end() -> None:
            if not task.cancelling():  # Ctrl-C may have come first
                task.cancel()

        unread = until_the_reader_leaves(loop, task.cancel) if listening else None
        with Ending(end, CREW_LAST_WORDS) as ending:
            ending.at(signal.SIGTERM, signal.SIGHUP)
            if on_screen:
                ending.with_terminal()
            try:
                return await task
            except asyncio.CancelledError:
                if unread is not None and unread():
                    forget_the_reader()
                    return exit_codes.DONE
                complain(Interrupted())
                return exit_codes.INTERRUPTED

    _find_room_for_a_loop()
    with asyncio.Runner() as runner:
        runner.get_loop()  # first: where it fails, nothing has begun
        return runner.run(obeying())


def _find_room_for_a_loop() -> None:
    """Try whether the descriptors of an event loop are free: asyncio prints a traceback of its own if not.

    Raises:
        OSError: they are not.
    """
    with select.epoll():
        for end in socket.socketpair():
            end.close()
