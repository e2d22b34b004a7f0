"""A small process beside an agent that runs authors' code: it kills one that does not end when asked to.

Python's signal handlers, and every thread, need the interpreter's lock. A page that computes in one call
into C (a regular expression, a number of a million digits) holds it; then nothing in its process can end
that. But the C part of Python notes each signal in a pipe, without that lock (`signal.set_wakeup_fd`). The
guard reads this pipe. When a signal, or the end of the tether, has asked for the end, the agent has `LIMIT`
for it; then the guard kills it. When the agent has ended, in any way, the guard ends, too.

The guard is this file, run alone: an interpreter without `site`, 3 MB, in a session of its own.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import time
from collections.abc import Generator
from functools import partial

LIMIT = 3.5
"""[s] from the request to end until the agent is killed: more than it has itself, see `ending.LAST_WORDS`."""

STDIN, STDERR = 0, 2
"""File descriptors."""

NAME = "robotree-guard"
"""The name that `ps -o comm` shows."""

ENDING = frozenset({signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
"""Signals that ask an agent to end."""


@contextlib.contextmanager
def guarded(*, tether: bool) -> Generator[None]:
    """Have this process ended by a guard when it is asked to end and does not. In the main thread.

    Where no guard can be started, as without memory, the agent runs without one and says so.

    Args:
        tether: whether the end of standard input asks for the end, too.
    """
    import subprocess

    asked, note = os.pipe()
    os.set_blocking(note, False)
    try:
        agent = os.pidfd_open(os.getpid())
        words = [sys.executable, "-I", "-S", __file__, str(os.getpid()), str(agent), str(asked)]
        guard = subprocess.Popen(
            [*words, "tether" if tether else ""],
            stdin=None if tether else subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=(agent, asked),
            start_new_session=True,  # Ctrl-C and a closed terminal are for the agent
        )
    except OSError as error:
        text = (
            f"robotree: no guard could be started ({error}); if this process hangs, only `kill -9` ends it\n"
        )
        os.write(STDERR, text.encode())
        yield
        return
    # what a page forks has its own signals: the end of a worker of multiprocessing is not ours
    os.register_at_fork(after_in_child=partial(signal.set_wakeup_fd, -1))
    before = signal.set_wakeup_fd(note, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        guard.returncode = 0  # it ends after this process: nobody waits for it


def watch(process: int, agent: int, asked: int, *, tether: bool, limit: float = LIMIT) -> None:
    """Be the guard of an agent until that has ended.

    Args:
        process: its id, for messages.
        agent: its pidfd: readable when it has ended, and of no other process ever.
        asked: read end of the pipe in which its signals are noted.
        tether: whether a hang-up of standard input asks for its end.
        limit: [s] from the request to end until it is killed.
    """
    events = select.poll()
    events.register(agent, select.POLLIN)
    events.register(asked, select.POLLIN)
    if tether:
        events.register(STDIN, 0)  # a hang-up is always reported; the input is the agent's
    latest: float | None = None
    while True:
        left = None if latest is None else max(latest - time.monotonic(), 0.0) * 1000
        ready = {number for number, _ in events.poll(left)}
        if agent in ready:
            return
        if not ready:
            _kill(process, agent, limit)
            return
        wanted = asked in ready and bool(ENDING.intersection(os.read(asked, 4096)))
        if STDIN in ready:
            events.unregister(STDIN)
            wanted = True
        if wanted and latest is None:
            latest = time.monotonic() + limit


def _kill(process: int, agent: int, limit: float) -> None:
    with contextlib.suppress(ProcessLookupError):
        signal.pidfd_send_signal(agent, signal.SIGKILL)
    reason = f"it did not end within {limit:g} s, for its code holds the interpreter"
    text = f"robotree: process {process} was killed: {reason}\n"
    with contextlib.suppress(OSError):
        if select.select([], [STDERR], [], 0)[1]:
            os.write(STDERR, text.encode())


def _main() -> None:
    for number in ENDING:  # those are for the agent; a service manager sends them to both
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        comm = os.open("/proc/self/comm", os.O_WRONLY)  # pathlib would double the time of the start
        os.write(comm, NAME.encode())
        os.close(comm)
    process, agent, asked = map(int, sys.argv[1:4])
    watch(process, agent, asked, tether=sys.argv[4] == "tether")


if __name__ == "__main__":
    _main()
