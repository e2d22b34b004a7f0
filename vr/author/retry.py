"""`@retry(times=3, backoff="1 s")`: call a method of a page again when it has failed.

    @retry(times=3, backoff="1 s")
    def take(self, shelf: int) -> None:
        self.arm.go_to(x=0.3, y=0, z=0.1 * shelf, twist=0)
        self.arm.grip(action="close")

Only what has surely failed is repeated. Each repetition makes new calls, which have new keys.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec, TypeVar

from robotree.vr.author.command import is_command
from robotree.vr.author.context import running
from robotree.vr.base.errors import Busy, CommandFailed, VrError
from robotree.vr.base.units import seconds

P = ParamSpec("P")
R = TypeVar("R")
_REPEATABLE = (CommandFailed, Busy)
"""Errors of ours after which a repetition is safe: all others mean an end, a mistake or a doubt."""


def retry(*, times: int, backoff: float | str = 0.0) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Repeat a method of a page when it fails.

    It is repeated after `CommandFailed`, `Failed` and `Busy`, and after an error class of a page. It is never
    repeated after a cancel, a deadline, the limit of a call, a stop, a lost child or a doubt, nor when one of
    these is the cause of the error or was being handled; nor after a wrong argument or an error of Python.

    Args:
        times: how often it is called at most, the first time included.
        backoff: [s], or text with a unit: the wait before the first repetition, twice as long before each
            further one.

    Raises:
        TypeError: `times` is no number above 0, or it stands above `@command`.
        ValueError: `backoff` is no time.
    """
    number: Any = times
    if not isinstance(number, int) or number < 1:
        raise TypeError(f"retry(times={times!r}): give how often it is called at most, such as 3")
    pause = seconds(backoff)

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        if is_command(function):
            name = getattr(function, "__name__", "a method")
            raise TypeError(f"{name}: write @command above @retry")

        @functools.wraps(function)
        def repeat(*values: P.args, **arguments: P.kwargs) -> R:
            activity = running()
            for attempt in range(1, times):
                try:
                    return function(*values, **arguments)
                except Exception as error:
                    if not _may_repeat(error):
                        raise
                    wait = pause * 2 ** (attempt - 1)
                    text = f"{type(error).__name__}: {error}"
                    activity.say(
                        "warning", f"attempt {attempt} of {times} failed: {text}; again in {wait:g} s"
                    )
                activity.sleep(wait)
            return function(*values, **arguments)

        return repeat

    return decorate


def _may_repeat(error: Exception) -> bool:
    """Whether it is sure what has happened, and a repetition can make sense."""
    if not isinstance(error, _REPEATABLE) and type(error).__module__ == "builtins":
        return False
    return all(isinstance(each, _REPEATABLE) for each in _chain(error) if isinstance(each, VrError))


def _chain(error: BaseException) -> Iterator[BaseException]:
    """Yield an error, what caused it, and what was being handled when it was raised."""
    todo: list[BaseException | None] = [error]
    seen: set[int] = set()
    while todo:
        each = todo.pop()
        if each is not None and id(each) not in seen:
            seen.add(id(each))
            yield each
            todo += [each.__cause__, each.__context__]
