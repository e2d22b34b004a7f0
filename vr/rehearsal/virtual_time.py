"""An event loop whose clock jumps: hours pass in a moment, in the same order each time.

When nothing is left to do now, the clock goes on to the next timer instead of waiting for it. For tests of
whatever takes its time from the event loop and has no threads of its own.
"""

from __future__ import annotations

import asyncio
import functools
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Its time begins at 0 and passes only when everybody waits."""

    def __init__(self) -> None:
        """Begin at 0."""
        self._now = 0.0
        super().__init__(_JumpingSelector(self))

    def time(self) -> float:
        """Return the virtual time [s]."""
        return self._now

    def jump(self, seconds: float) -> None:
        """Let time pass."""
        self._now += seconds


class _JumpingSelector(selectors.DefaultSelector):
    """Never waits: lets the loop's time pass instead."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events = super().select(0)
        if events or timeout == 0:
            return events
        if timeout is None:
            raise RuntimeError("everybody waits, and nothing will ever happen")
        self._loop.jump(timeout)
        return []


def run_in_virtual_time(story: Coroutine[Any, Any, _R]) -> _R:
    """Run a story to its end, and what it left behind, in no time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(story)


def in_virtual_time(story: Callable[_P, Coroutine[Any, Any, None]]) -> Callable[_P, None]:
    """Make a plain function, for instance a test, of a story that is told in virtual time."""

    @functools.wraps(story)
    def tell(*args: _P.args, **kwargs: _P.kwargs) -> None:
        run_in_virtual_time(story(*args, **kwargs))

    return tell
