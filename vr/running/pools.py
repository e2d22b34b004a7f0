"""Thread pools work for the command that gives them work, as if it had called the function itself.

Python hands the context of a thread on to `asyncio.to_thread`, but not to `concurrent.futures`: without
this, a function that a page gives to a `ThreadPoolExecutor` could not call a child. What it calls has keys
that follow from the order in which the work was given, not from which thread is quicker.

In a simulation no thread can wait in virtual time: there the work is done at once, in the order in which it
is given.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from robotree.vr.author.context import commander_here

_submit = ThreadPoolExecutor.submit


def hand_on() -> None:
    """Have the thread pools of this process work for commands. Twice is once."""
    ThreadPoolExecutor.submit = _hand_on  # type: ignore[assignment, method-assign] # there is no hook


def _hand_on(
    pool: ThreadPoolExecutor, work: Callable[..., Any], /, *values: Any, **arguments: Any
) -> Future[Any]:
    commander = commander_here()
    if commander is None:
        return _submit(pool, work, *values, **arguments)
    run = commander.handed_on(work)
    if not commander.simulated:
        return _submit(pool, run, *values, **arguments)
    future: Future[Any] = Future()
    try:
        future.set_result(run(*values, **arguments))
    except Exception as error:  # noqa: BLE001 # raised where the result is asked for
        future.set_exception(error)
    return future
