"""Ends code that computes without ever waiting: in virtual time nothing else would run beside it, for ever.

In a real process such code is interrupted and abandoned; a rehearsal has one thread, so another one watches
it in real time and raises an error in it, as `running.interruptible` does.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager

from robotree.vr.world.virtual_runner import VirtualRunner

LIMIT = 10.0
"""[s] of real time that code may compute without waiting."""


class Endless(BaseException):
    """Raised in code that computes without waiting; no `Exception`, so that few catch it."""


@contextmanager
def watched(runner: VirtualRunner) -> Generator[None]:
    """Interrupt what stands in the way of a runner inside the block, `LIMIT` after it last let others run."""
    done = threading.Event()
    thread = threading.get_ident()
    watcher = threading.Thread(
        target=_watch, args=(runner, thread, done), name="rehearsal watch", daemon=True
    )
    watcher.start()
    try:
        yield
    finally:
        while watcher.is_alive():
            try:
                done.set()
                watcher.join()
                for _ in range(2):  # what was raised and has not arrived arrives when a loop turns
                    pass
            except Endless:  # the block is left, nothing more is to be ended
                pass


def _watch(runner: VirtualRunner, thread: int, done: threading.Event) -> None:
    strike = ctypes.pythonapi.PyThreadState_SetAsyncExc
    ident, error = ctypes.c_ulong(thread), ctypes.py_object(Endless)
    seen, since = (0, 0.0), time.monotonic()
    while not done.wait(LIMIT / 10):
        now = runner.switches, runner.now()
        if now != seen:
            seen, since = now, time.monotonic()
        elif time.monotonic() - since > LIMIT and not runner.holding:  # else a lock would stay held
            strike(ident, error)
            since = time.monotonic()
