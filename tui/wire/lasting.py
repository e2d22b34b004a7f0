"""A verb that runs until it is ended: by Ctrl-C or SIGTERM, by `--for TIME`, or because a link ended."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncGenerator, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from robotree.protocol.errors import LinkClosed
from robotree.tui import exit_codes
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import complain, note

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Lasting:
    """Waits for the end. Made by `lasting`."""

    def __init__(self) -> None:
        """Begin to last."""
        self._over: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()

    @property
    def over(self) -> bool:
        """Whether the end has come."""
        return self._over.done()

    def end(self, reason: Exception | None = None) -> None:
        """End it, with what ended a link, or went wrong beside it; only the first reason counts."""
        if not self._over.done():
            self._over.set_result(reason)

    async def wait(self, limit: float | None = None) -> None:
        """Return at the end, or after `limit` [s]."""
        await asyncio.wait([self._over], timeout=limit)

    async def until(self, happening: Coroutine[Any, Any, Any]) -> None:
        """Return when something has happened, or at the end."""
        task = asyncio.ensure_future(happening)
        await asyncio.wait([task, self._over], return_when=asyncio.FIRST_COMPLETED)
        task.cancel()

    def exit_code(self) -> int:
        """Say what ended a link, if something did, and return the exit code.

        Raises:
            OSError: it was no link, but what is written to.
        """
        reason = self._over.result() if self._over.done() else None
        if reason is None:
            return exit_codes.DONE
        if isinstance(reason, LinkClosed):
            note(str(reason))
            return exit_codes.DONE
        if isinstance(reason, OSError):
            raise reason
        complain(reason)
        return exit_codes.REFUSED


@asynccontextmanager
async def lasting(line: Line) -> AsyncGenerator[Lasting]:
    """Last, inside the block, for the line's `--for TIME`.

    Args:
        line: whose option counts; without it only a signal or a link's end ends.

    Yields:
        To be waited for.
    """
    limit = values.duration(line.text("--for")) if line.text("--for") else None
    loop, here = asyncio.get_running_loop(), Lasting()
    for one in _SIGNALS:
        loop.add_signal_handler(one, here.end)
    timer = None if limit is None else loop.call_later(limit, here.end)
    try:
        yield here
    finally:
        if timer is not None:
            timer.cancel()
        for one in _SIGNALS:
            loop.remove_signal_handler(one)
