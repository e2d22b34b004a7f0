"""Frames on their way from the links to the physics: bounded, fair, and never in the way of a stop.

Each link has a queue of its own. What is heard before a batch is at most `TURN` frames of each link; of what
a link brings beyond `LARGEST_QUEUE` the newest is dropped and counted, so a client that floods costs itself.
A stop goes before everything; a second one of a link that still waits says nothing new, and is not queued.
"""

import threading
from collections import deque
from collections.abc import Hashable, Iterator
from typing import Final, NamedTuple

from robotree.protocol.frame import Frame
from robotree.protocol.messages import CommandInt, CommandLong, MavCmd, ModeKind, SetMode

LARGEST_QUEUE: Final = 256
"""Frames of one link that wait."""
TURN: Final = 16
"""Frames of one link that are heard before a batch of 5 ms: 3200 in a second."""
LARGEST_STOPS: Final = 8
"""Stops of one link that wait; each is answered."""


class Opened(NamedTuple):
    """A link was opened."""

    via: Hashable


class Heard(NamedTuple):
    """A frame came over a link."""

    frame: Frame
    via: Hashable


class Closed(NamedTuple):
    """A link has ended."""

    via: Hashable


Event = Opened | Heard | Closed


class Intake:
    """The queues of one controller. Filled from any thread, emptied by the thread of the physics."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._stops: dict[Hashable, deque[Heard]] = {}
        self._queues: dict[Hashable, deque[Event]] = {}
        self.dropped = 0
        """Frames that found their link's queue full."""

    def open(self, via: Hashable) -> None:
        """A link was opened."""
        with self._lock:
            self._queues.setdefault(via, deque()).append(Opened(via))

    def put(self, frame: Frame, via: Hashable) -> None:
        """A frame came."""
        stop = is_stop(frame)
        with self._lock:
            queue = (self._stops if stop else self._queues).setdefault(via, deque())
            if len(queue) < (LARGEST_STOPS if stop else LARGEST_QUEUE):
                queue.append(Heard(frame, via))
            else:
                self.dropped += not stop

    def close(self, via: Hashable) -> None:
        """A link has ended; it comes after what was still heard on it."""
        with self._lock:
            self._queues.setdefault(via, deque()).append(Closed(via))

    def take(self) -> list[Event]:
        """What is heard before the next batch: all stops, then a turn of each link."""
        if not self._stops and not self._queues:
            return []
        with self._lock:
            events: list[Event] = [event for queue in self._stops.values() for event in queue]
            self._stops.clear()
            for queue in self._queues.values():
                events += _pop(queue)
            self._queues = {via: queue for via, queue in self._queues.items() if queue}
        return events


def _pop(queue: deque[Event]) -> Iterator[Event]:
    for _ in range(min(TURN, len(queue))):
        yield queue.popleft()


def is_stop(frame: Frame) -> bool:
    """Whether a frame asks for the protective stop, in any of the ways that there are."""
    message = frame.message
    if isinstance(message, SetMode):
        return message.mode == ModeKind.SAFE_STOP
    if not isinstance(message, CommandLong | CommandInt):
        return False
    match message.command:
        case MavCmd.COMPONENT_ARM_DISARM:
            return message.param1 == 0.0
        case MavCmd.DO_FLIGHTTERMINATION:
            return message.param1 > 0.0
        case MavCmd.DO_SET_MODE:
            return message.param2 == ModeKind.SAFE_STOP
        case _:
            return False
