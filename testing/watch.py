"""Ends code that computes without ever waiting: in virtual time nothing else would run beside it, for ever.

In a real process such code is interrupted and abandoned; a rehearsal has one thread, so another one watches
its processor time and raises an error in it, as `running.runner` does.
"""

from __future__ import annotations

import ctypes
import sys
import sysconfig
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager

from robotree.vr.world.virtual_runner import VirtualRunner

LIMIT = 10.0
"""[s] of processor time that code may take without waiting."""

_LIBRARY = (sysconfig.get_path("stdlib"), "<frozen")


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
    clock = time.pthread_getcpuclockid(thread)  # a machine that is busy elsewhere takes none of it
    seen, since = (0, 0.0), time.clock_gettime(clock)
    while not done.wait(LIMIT / 10):
        now = runner.switches, runner.now()
        if now != seen:
            seen, since = now, time.clock_gettime(clock)
        elif time.clock_gettime(clock) - since > LIMIT and not runner.holding:  # else a lock would stay held
            if _is_in_robotree(thread):
                runner.interrupt_running(Endless)
            else:
                strike(ident, error)
            since = time.clock_gettime(clock)
    runner.struck.pop(None, None)


def _is_in_robotree(thread: int) -> bool:
    """Whether a thread is in code of robotree, or of the standard library on its behalf.

    Such code may be between two statements that belong together, as taking a lock and noting its holder.
    """
    frame = sys._current_frames().get(thread)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] # documented
    while frame is not None and frame.f_code.co_filename.startswith(_LIBRARY):
        frame = frame.f_back
    return frame is not None and frame.f_globals.get("__name__", "").startswith("robotree.")
