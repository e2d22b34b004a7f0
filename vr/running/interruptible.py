"""A thread for an author's code, which can be interrupted even when that code asks nobody.

Python can raise an exception in another thread (`Threads.interrupt`); it arrives between two bytecodes, so a
pure Python loop ends, while a call that never returns to Python does not. The thread is a daemon: its process
can end at any time.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable

from robotree.files import forks
from robotree.vr.running.runner import Threads


class Interrupted(BaseException):
    """Raised inside of an author's code that did not listen; no Exception, so that few catch it."""


class InterruptibleThread:
    """Runs one function and reports how it ended."""

    def __init__(
        self, work: Callable[[], object], done: Callable[[object, BaseException | None], None], *, name: str
    ) -> None:
        """Prepare; `start` begins.

        Args:
            work: what runs.
            done: told the value or the error, in the thread itself; must not raise.
            name: of the thread, for debuggers.
        """
        self._work, self._done = work, done
        self._lock = threading.Lock()
        self._inside = True
        self._thread = threading.Thread(target=self.run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def interrupt(self) -> None:
        """Raise Interrupted in the work if it still runs."""
        with self._lock:
            if self._inside:
                Threads().interrupt(self._thread.ident or 0, Interrupted)

    def run(self) -> None:
        """Do the work in the thread that calls this."""
        outcome: tuple[object, BaseException | None] | None = None
        while self._inside:  # an interruption may strike anywhere in here
            with contextlib.suppress(Interrupted):
                if outcome is None:
                    outcome = (None, Interrupted())
                    outcome = self._run()
                self._leave()
        self._done(*(outcome or (None, Interrupted())))

    def _run(self) -> tuple[object, BaseException | None]:
        try:
            return self._work(), None
        except BaseException as error:  # noqa: BLE001 # the last fence around foreign code
            return None, error
        finally:
            forks.expect_parent()

    def _leave(self) -> None:
        """Let nothing strike from here on: what was raised and has not arrived arrives in the loop.

        It is not taken back by raising NULL instead: CPython 3.11 then looks for it for ever, in all threads,
        and a process that is traced or profiled makes no progress any more.
        """
        with self._lock:
            self._inside = False
        for _ in range(2):  # Python looks for what was raised whenever a loop turns
            pass
