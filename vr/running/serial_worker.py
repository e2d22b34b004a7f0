"""Work that is done in a thread, one piece after the other, in the order in which it was submitted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from robotree.vr.running.runner import Runner


class SerialWorker:
    """Does one thing after the other, in the order in which they were submitted.

    Its thread lives only while there is something to do. Work that never ends holds up what comes after it,
    and no end of the process.
    """

    def __init__(self, runner: Runner, name: str) -> None:
        """Begin with nothing to do.

        Args:
            runner: that spawns the thread.
            name: of the thread.
        """
        self._runner, self._name = runner, name
        self._lock = runner.lock()
        self._ahead: deque[tuple[Future[bool], Callable[[], bool]]] = deque()
        self._working = False

    def submit(self, work: Callable[[], bool]) -> Future[bool]:
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
            self._runner.spawn(self._work, self._name)
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
