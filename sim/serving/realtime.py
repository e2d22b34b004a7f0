"""Real time: runs a controller in a thread, in step with the wall clock.

Deadlines are absolute, one per batch; in a world that runs faster, one for as many batches as make up that
time of the wall clock, so that its thread wakes no more often. Physics and control run in lock step on
simulated time, so jitter of the thread cannot disturb the contact. A debt is made good slowly: a controller
whose clock jumped would end a goal long before its time to live, and move faster than its limits. A debt of
more than a quarter second (a suspended laptop) is dropped and counted, not made up.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from robotree.sim.controller.controller import Controller
from robotree.sim.firmware import Outgoing
from robotree.sim.physics.cell import BATCH

LOAD_SHARE: Final = 0.01
"""Share of the latest batch in the reported load: a time constant of half a second."""


LARGEST_DEBT: Final = 0.25
"""[s] behind the wall clock that is still made good."""
FASTEST: Final = 1.25
"""Seconds of the controller in one of the wall clock, at most, while a debt is made good."""


@dataclass(frozen=True, slots=True)
class Pace:
    """One reading of how real time is kept: controller time [ms], and debt that was dropped [s]."""

    time_ms: int
    dropped: float


class Pacer:
    """Counts deadlines: they are absolute, so a late wake-up is made good by the next batches.

    Args:
        period: of one batch [s].
        now: the wall clock [s].
    """

    def __init__(self, period: float, now: float) -> None:
        self._period = period
        self._due = self._begins = now
        self.dropped = 0.0
        """[s] of debt that was dropped so far."""

    def wait(self, now: float) -> float:
        """After a batch: how long to sleep before the next one [s], not below 0."""
        self._due += self._period
        debt = now - self._due
        if debt > LARGEST_DEBT:
            self.dropped += debt
            self._due = now
        self._begins = max(self._due, self._begins + self._period / FASTEST, now)
        return self._begins - now


class RealTime:
    """Runs a controller in a thread until it is closed.

    Args:
        controller: from now on touched by that thread alone, but for `post`.
        tell: called in that thread with what there is to say after a batch.
        fail: called in that thread with what ended it, if something did.
        speedup: seconds of the world in a second.
    """

    def __init__(
        self,
        controller: Controller,
        tell: Callable[[list[Outgoing]], None],
        fail: Callable[[Exception], None],
        speedup: float = 1.0,
    ) -> None:
        self._controller, self._tell, self._fail = controller, tell, fail
        self._over = threading.Event()
        self._batches = max(1, int(speedup))  # one wake-up is not for less wall clock than in real time
        period = self._batches * BATCH * float(controller.cell.model.opt.timestep) / speedup
        self._period = period
        self._pacer = Pacer(period, time.monotonic())
        self._thread = threading.Thread(target=self._run, name="cell", daemon=True)
        self._thread.start()

    @property
    def pace(self) -> Pace:
        """How real time is kept."""
        return Pace(self._controller.cell.time_ms, self._pacer.dropped)

    def close(self) -> None:
        """End the thread."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        gauges, began = self._controller.firmware.gauges, time.thread_time()
        try:
            while not self._over.is_set():
                for _ in range(self._batches):
                    if out := self._controller.advance():
                        self._tell(out)
                now = time.thread_time()
                gauges.load += LOAD_SHARE * ((now - began) / self._period - gauges.load)
                began = now
                time.sleep(self._pacer.wait(time.monotonic()))
        except Exception as error:  # noqa: BLE001  outermost handler of the thread; its owner is told
            self._fail(error)
