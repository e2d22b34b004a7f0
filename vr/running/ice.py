"""The stillness of a robot that may be about to leave its process.

First its threads come to a wait (`Frame.stand`); the core goes on meanwhile. Then the ice is closed: the
core takes nothing any more but renewals, what comes is held or put off, and the state is the parcel. In the
end the robot goes on here, or it has left: then its threads end, and no code of its page does anything more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from robotree.vr.core.events import CoreEvent
from robotree.vr.running.runner import Runner

MOST_HELD = 4096
"""Requests that are held for a robot on its way; more are passed on, as if it had left."""


class GoneOn(BaseException):
    """Raised in code of a robot that goes on in another process, at each further call."""


class Frozen(Exception):
    """A robot is on its way: a call in its process is to wait for the end of that."""

    def __init__(self, ice: Ice) -> None:
        """Name what to wait for."""
        super().__init__("it is on its way")
        self.ice = ice


class AtWork(Protocol):
    """Code at work on a worker, as the ice knows it: a `Frame`."""

    parked: bool

    @property
    def above(self) -> object:
        """The code on the same worker for which it waits; None: for none."""
        ...

    def wake(self) -> None:
        """Have its thread look around. From any thread."""
        ...


class Ice:
    """See the module."""

    closed: bool = False
    """Whether the core takes nothing any more."""
    over: bool = False
    """Whether it has melted: the robot goes on here, or has left."""
    moved: bool = False
    """Whether it has left."""

    def __init__(self, runner: Runner) -> None:
        """Begin; the core is open."""
        self._lock = runner.lock()
        self.deferred: list[CoreEvent | Callable[[], object]] = []
        """What the core is told, and what is done, if the robot goes on here; in this order."""
        self._held: list[tuple[Callable[[], object], Callable[[], object]]] = []
        self._wakers: list[Callable[[], object]] = []

    def hold(self, here: Callable[[], object], elsewhere: Callable[[], object]) -> bool:
        """Hold a request.

        Args:
            here: deals with it if the robot goes on here.
            elsewhere: has it asked again where the robot goes on.

        Returns:
            False: it is over, and the robot goes on here.
        """
        with self._lock:
            full = len(self._held) >= MOST_HELD
            if not self.over and not full:
                self._held.append((here, elsewhere))
                return True
        if self.moved or full:
            elsewhere()
            return True
        return False

    def when_over(self, wake: Callable[[], object]) -> None:
        """Call back when it is over, or at once."""
        with self._lock:
            if not self.over:
                self._wakers.append(wake)
                return
        wake()

    def melt(self, *, moved: bool) -> None:
        """Be over: what was held is dealt with, who waits is woken."""
        with self._lock:
            self.moved, self.over = moved, True
            held, self._held = self._held, []
            wakers, self._wakers = self._wakers, []
        for wake in wakers:
            wake()
        for here, elsewhere in held:
            (elsewhere if moved else here)()
