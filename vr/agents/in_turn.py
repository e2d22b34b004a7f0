"""Work that is done in a thread, one piece after the other, in the order in which it was given."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future


class InTurn:
    """A queue with a thread behind it, which lives only while there is something to do.

    The thread is a daemon: work that never ends holds up what comes after it, and no end of the process.
    """

    def __init__(self, name: str) -> None:
        """Begin with nothing to do; `name` is that of the thread."""
        self._name = name
        self._lock = threading.Lock()
        self._ahead: deque[tuple[Future[bool], Callable[[], bool]]] = deque()
        self._working = False

    def give(self, work: Callable[[], bool]) -> Future[bool]:
        """Have it done when all that was given before has ended. From any thread.

        Args:
            work: returns whether it went well; raises nothing.

        Returns:
            What it returns, once it has ended. Cancelled before it has begun, it never does.
        """
        turn: Future[bool] = Future()
        with self._lock:
            self._ahead.append((turn, work))
            idle, self._working = not self._working, True
        if idle:
            threading.Thread(target=self._work, name=self._name, daemon=True).start()
        return turn

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._ahead:
                    self._working = False
                    return
                turn, work = self._ahead.popleft()
            if turn.set_running_or_notify_cancel():
                turn.set_result(work())
