"""Frames on their way from the links to the physics: bounded, fair, and never in the way of a stop.

Each link has a queue of its own, and credit that grows with every batch: a frame costs 1, one for which a
way has to be planned `PLANNED`, a set-point `FOLLOWED`, as their processor time does. Of what a link brings
beyond `LARGEST_QUEUE` the newest is dropped and counted, so a client that floods costs itself. A stop goes
before everything. When several of a link wait already, one more says nothing new: it is not queued, but
counts as dropped, since nobody answers it.

A link that has ended has one more turn: what it has no credit for then is dropped and counted. What waits on
a link that stands is heard late. So every arrival is stamped with controller time, from which silence and the
age of set-points are counted.

What a stop has overtaken must not undo it. So every arrival is stamped with the number of stops that arrived
before it, on whatever link: what is heard with an older stamp than the newest stop is marked as overtaken.
"""

import threading
from collections import deque
from collections.abc import Hashable, Iterator
from typing import Final, NamedTuple

from robotree.protocol.frame import Frame
from robotree.protocol.messages import CommandInt, CommandLong, Goal, Setpoint, Verb
from robotree.sim.firmware.commands import MOVING
from robotree.sim.firmware.outgoing import COMPONENT
from robotree.sim.firmware.stops import stop_asked_by

LARGEST_QUEUE: Final = 256
"""Frames of one link that wait."""
CREDIT: Final = 16
"""By which each link's credit grows before a batch of 5 ms, never beyond: 3200 in a second."""
ALL_CREDIT: Final = 64
"""By which the credit of all links together grows, when there are many."""
PLANNED: Final = 64
"""Cost of a goal or a command that moves: its way takes 1 to 5 ms to plan, so a link gets 50 in a second."""
FOLLOWED: Final = 8
"""Cost of a set-point: its posture takes 0.1 to 1 ms to find, so a link gets 400 in a second."""
LARGEST_STOPS: Final = 8
"""Stops of one link that wait; each is answered."""


class Opened(NamedTuple):
    """A link was opened."""

    via: Hashable


class Heard(NamedTuple):
    """A frame came over a link.

    Attributes:
        frame: as it came.
        via: that link.
        stops: that had arrived before it, on all links; its stamp.
        arrived: when it did, in controller time [ms].
        overtaken: whether a stop that arrived later, on any link, is heard before it.
    """

    frame: Frame
    via: Hashable
    stops: int = 0
    arrived: int = 0
    overtaken: bool = False


class Closed(NamedTuple):
    """A link has ended."""

    via: Hashable


Event = Opened | Heard | Closed


class Intake:
    """The queues of one controller. Filled from any thread, emptied by the thread of the physics.

    Args:
        system: the controller's MAVLink system id; a stop for another one is none.
    """

    def __init__(self, system: int) -> None:
        self._system = system
        self._lock = threading.Lock()
        self._arrived = 0
        self._stops: dict[Hashable, deque[Heard]] = {}
        self._queues: dict[Hashable, deque[Event]] = {}
        self._debts: dict[Hashable, int] = {}
        self.dropped = 0
        """Frames that found their link's queue full, or that waited when it ended."""

    @property
    def stops(self) -> int:
        """How many stops have arrived so far: the stamp of what arrives now."""
        return self._arrived

    def open(self, via: Hashable) -> None:
        """A link was opened."""
        with self._lock:
            self._queues.setdefault(via, deque()).append(Opened(via))

    def put(self, frame: Frame, via: Hashable, stops: int | None = None, now: int = 0) -> None:
        """A frame came.

        Args:
            frame: intact.
            via: the link.
            stops: the stamp of the moment when its bytes came, if they waited since; None: they came now.
            now: controller time [ms].
        """
        stop = stop_asked_by(frame.message) and frame.is_for(self._system, COMPONENT)
        with self._lock:
            stamp = self._arrived if stops is None else stops
            self._arrived += stop
            queue = (self._stops if stop else self._queues).setdefault(via, deque())
            if len(queue) < (LARGEST_STOPS if stop else LARGEST_QUEUE):
                queue.append(Heard(frame, via, stamp, now))
            else:
                self.dropped += 1

    def close(self, via: Hashable) -> None:
        """A link has ended; it comes after what is still heard on it."""
        with self._lock:
            self._queues.setdefault(via, deque()).append(Closed(via))

    def take(self) -> list[Event]:
        """What is heard before the next batch: all stops, then what each link has credit for."""
        if not self._stops and not self._queues:
            return []
        with self._lock:
            events: list[Event] = [event for queue in self._stops.values() for event in queue]
            self._stops.clear()
            credit = min(CREDIT, max(ALL_CREDIT // max(len(self._queues), 1), 1))
            for via, queue in self._queues.items():
                events += map(self._judge, self._pop(via, queue, credit))
                if queue and isinstance(end := queue[-1], Closed):
                    self.dropped += len(queue) - 1
                    queue.clear()
                    events.append(end)
            self._queues = {via: queue for via, queue in self._queues.items() if queue or via in self._debts}
        return events

    def _judge(self, event: Event) -> Event:
        if isinstance(event, Heard) and event.stops < self._arrived:
            return event._replace(overtaken=True)
        return event

    def _pop(self, via: Hashable, queue: deque[Event], credit: int) -> Iterator[Event]:
        """What a link has credit for; the last frame may cost more, which it pays back before the next."""
        credit -= self._debts.pop(via, 0)
        while queue and credit > 0:
            event = queue.popleft()
            credit -= _cost(event)
            yield event
        if credit < 0:
            self._debts[via] = -credit


def _cost(event: Event) -> int:
    if not isinstance(event, Heard):
        return 1
    message = event.frame.message
    if isinstance(message, Setpoint):
        return FOLLOWED
    if isinstance(message, Goal):
        return PLANNED if message.verb != Verb.STATUS else 1
    return PLANNED if isinstance(message, CommandLong | CommandInt) and message.command in MOVING else 1
