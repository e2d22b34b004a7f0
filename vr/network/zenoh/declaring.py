"""Declares in a thread what somebody must own: a declaration holds a name for as long as it exists.

The wire has the like for adapters (`protocol/links/in_thread.py`). Wire and agents know nothing of each
other, which is worth more than these lines.
"""

from __future__ import annotations

import asyncio
import contextlib
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

T = TypeVar("T")


async def made(threads: Executor, make: Callable[[], T], unmake: Callable[[T], object]) -> T:
    """Make something in a thread.

    No thread can be stopped. So for who is cancelled meanwhile the thread unmakes what nobody will own. That
    is waited for, unless one is cancelled again; it happens in either case.

    Args:
        threads: where; once they are shut down, nothing is unmade any more.
        make: may block; what it raises is raised here.
        unmake: what to do with what was made for nobody; may block.
    """
    loop = asyncio.get_running_loop()
    making = Future[T]()
    over = loop.run_in_executor(threads, _make, make, making)
    try:
        await asyncio.shield(over)
    except asyncio.CancelledError:
        with contextlib.suppress(RuntimeError):  # the threads have ended, and all that was made with them
            # from a thread: if it has been made in this very moment, it is unmade at once and there
            giving_up = loop.run_in_executor(threads, making.add_done_callback, partial(_unmake, unmake))
            await asyncio.wait([over, giving_up])
        raise
    return making.result()


def _make(make: Callable[[], T], making: Future[T]) -> None:
    try:
        making.set_result(make())
    except BaseException as error:  # noqa: BLE001 # whatever it is, it is raised where one waits
        making.set_exception(error)


def _unmake(unmake: Callable[[T], object], making: Future[T]) -> None:
    if making.exception() is None:
        unmake(making.result())
