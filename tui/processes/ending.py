"""The end of a process: asked for once, whatever asks and however often, and sure to come.

Several things may ask for it together: a signal, then another one, the terminal that closes, the starter that
ends. Only the first one counts, because a second cancel would break off the cleaning up that the first one
began. Should the event loop hang, the process ends all the same.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import signal
import socket
import stat
import threading
from collections.abc import Callable, Coroutine
from queue import SimpleQueue
from types import FrameType, TracebackType
from typing import Any, Self

from robotree.tui import exit_codes
from robotree.tui.errors import Interrupted
from robotree.tui.terminal import complain, forget_the_reader, until_the_reader_leaves

STDIN, STDERR = 0, 2
"""File descriptors."""

LAST_WORDS = 3.0
"""[s] allowed for an agent's polite end, before its process is ended anyway."""

CREW_LAST_WORDS = 4.0
"""[s] the same for a process that ends others first; a crew takes up to `crew.STOP_LIMIT`."""


class Ending:
    """A context in which a process can be asked to end, on the running event loop.

    Args:
        end: called on the loop, once, when the end is first asked for.
        limit: [s] allowed from then on, until the process is ended whatever it does.
    """

    def __init__(self, end: Callable[[], object], limit: float) -> None:
        self._end, self._limit = end, limit
        self._loop = asyncio.get_running_loop()
        self._asked: SimpleQueue[bool] = SimpleQueue()  # its `put` may interrupt itself, as signals do
        self._undo = contextlib.ExitStack()

    def __enter__(self) -> Self:
        """Begin to wait for the end, in a thread: the loop may be what hangs."""
        threading.Thread(target=self._see_to_it, name="ending", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the signals back. An end that was asked for still comes, should the interpreter hang."""
        self._undo.close()
        self._asked.put(False)

    def ask(self) -> None:
        """Ask for the end; from any thread or signal handler. Again is nothing more."""
        self._asked.put(True)

    def _see_to_it(self) -> None:
        if not self._asked.get():
            return
        with contextlib.suppress(RuntimeError):  # the loop has ended already
            self._loop.call_soon_threadsafe(self._end)
        threading.Event().wait(self._limit)
        with contextlib.suppress(OSError):
            if select.select([], [STDERR], [], 0)[1]:  # a terminal that takes nothing may be what holds us up
                os.write(STDERR, b"robotree: did not come to an end by itself, and was ended\n")
        os._exit(exit_codes.INTERRUPTED)

    # -- what may ask ------------------------------------------------------------------------------

    def at(self, *signals: signal.Signals) -> None:
        """End at these signals; not at a hang-up that is ignored already, as under `nohup`.

        Python's own handlers are used, not the loop's: they are heard while the loop waits for a lock.
        """
        for one in signals:
            if one == signal.SIGHUP and signal.getsignal(one) == signal.SIG_IGN:
                continue
            before = signal.signal(one, self._hear)
            self._undo.callback(signal.signal, one, signal.SIG_DFL if before is None else before)

    def _hear(self, _number: int, _frame: FrameType | None) -> None:
        self.ask()

    def with_terminal(self) -> None:
        """End when the terminal that is standard input closes; other inputs are left alone.

        A hang-up signal may never come: the kernel sends it to the leader of the session alone, and a
        `make` that leads it waits for its children and passes nothing on.
        """
        if not stat.S_ISCHR(os.fstat(STDIN).st_mode):
            return
        hangs_up = select.epoll()
        self._undo.callback(hangs_up.close)
        try:
            hangs_up.register(STDIN, 0)  # a hang-up is always told of, keys are not asked for
        except PermissionError:
            return  # /dev/null and its like cannot be waited for
        self._loop.add_reader(hangs_up, self._hung_up, hangs_up)
        self._undo.callback(self._loop.remove_reader, hangs_up)

    def _hung_up(self, hangs_up: select.epoll) -> None:
        self._loop.remove_reader(hangs_up)
        self.ask()

    def with_input(self) -> None:
        """End when standard input ends: the tether of an agent to its starter.

        A thread reads, because standard input may be anything, also what an event loop cannot wait for. It
        reads beneath Python's buffer, whose lock an interpreter that shuts down meanwhile could not take
        from it.
        """

        def wait() -> None:
            with contextlib.suppress(OSError):
                while os.read(STDIN, 64):
                    pass
            self.ask()

        threading.Thread(target=wait, name="tether", daemon=True).start()


# -- a program that works on an event loop to its end, whoever ends it -----------------------------


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
