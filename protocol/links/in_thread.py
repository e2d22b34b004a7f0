"""Opens what may take long, such as an adapter or a bus, in a thread; the wait for it can be cancelled.

The agents have similar code: wire and agents must not import each other, which matters more than these lines.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


async def opened(open_it: Callable[[], T], close: Callable[[T], object]) -> T:
    """Open something in a thread.

    No thread can be stopped. So for who is cancelled meanwhile the thread closes what nobody will own;
    otherwise it would stay open, held by nobody and in everybody's way. That is waited for, unless one is
    cancelled again; it happens in either case.

    Args:
        open_it: may block; what it raises is raised here.
        close: what to do with what was opened for nobody; may block. What it raises is logged.
    """
    loop = asyncio.get_running_loop()
    port = Future[T]()
    opening = loop.run_in_executor(None, _open, open_it, port)
    try:
        await asyncio.shield(opening)
    except asyncio.CancelledError:
        # from a thread: if it has been opened in this very moment, it is closed at once and there
        giving_up = loop.run_in_executor(None, port.add_done_callback, partial(_close, close))
        await asyncio.wait([opening, giving_up])
        raise
    return port.result()


def _open(open_it: Callable[[], T], port: Future[T]) -> None:
    try:
        port.set_result(open_it())
    except BaseException as error:  # noqa: BLE001 # whatever it is, it is raised where one waits
        port.set_exception(error)


def _close(close: Callable[[T], object], port: Future[T]) -> None:
    if port.exception() is None:
        close(port.result())
