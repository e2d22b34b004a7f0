"""One robot's controller: the cell, its firmware, and the inbox between them and the links.

A controller has one MAVLink component or several, each with a program and a device of its own in the same
cell: an arm has one, a companion four. Every program receives every frame and takes what is for it.

Frames may be posted from any thread; everything else happens in the thread that calls `advance`, one batch of
steps at a time. So a test in virtual time and a server in real time run the same code.

The inbox is bounded and fair, stops come first. Each link has its own queue, and credit that grows with every
batch. A frame costs 1, one that needs a planned path `PLANNED`, a set-point `FOLLOWED`, like their processor
time. Beyond `LARGEST_QUEUE` the newest frames of a link are dropped and counted, so a client that floods
harms only itself. A stop goes before everything. When several stops of a link wait, further ones are not
queued but counted as dropped, since they are not answered.

A link that has ended has one more turn; what its credit does not cover is dropped and counted. Frames of a
slow link are handled late. So every arrival is stamped with controller time, from which silence and the age
of set-points are counted.

A frame that arrived before a stop must not undo it. So every arrival is stamped with the number of stops that
arrived before it on any link; a frame with an older stamp than the newest stop is marked as overtaken.
"""

import threading
from collections import deque
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import msgspec

from robotree.protocol.frame import Frame
from robotree.protocol.messages import CommandInt, CommandLong, Goal, Setpoint, Verb
from robotree.protocol.services.picture import Camera
from robotree.sim.firmware import COMPONENT, Firmware, Outgoing
from robotree.sim.firmware.commands import MOVING
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.physics.cell import Cell

LARGEST_QUEUE: Final = 256
"""Waiting frames of one link."""
CREDIT: Final = 16
"""Credit of each link per batch of 5 ms, not saved up: 3200 per second."""
ALL_CREDIT: Final = 64
"""Credit of all links together per batch, when there are many."""
PLANNED: Final = 64
"""Cost of a goal or a command that moves: its path takes 1 to 5 ms to plan, so a link gets 50 per second."""
FOLLOWED: Final = 8
"""Cost of a set-point: its posture takes 0.1 to 1 ms to find, so a link gets 400 per second."""
_COMMANDS: Final = (CommandLong, CommandInt)
_COSTLY: Final = frozenset({Setpoint, Goal, *_COMMANDS})
"""Kinds of messages of which some cost more than 1."""
LARGEST_STOPS: Final = 8
"""Waiting stops of one link; each is answered."""


class Opened(NamedTuple):
    """A link was opened."""

    via: Hashable


class Received(NamedTuple):
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


InboxEvent = Opened | Received | Closed


class Inbox:
    """The queues of one controller. Filled from any thread, emptied by the thread of the physics.

    Args:
        system: the controller's MAVLink system id; stops for other systems are ordinary frames.
        components: its MAVLink components.
    """

    def __init__(self, system: int, components: Sequence[int] = (COMPONENT,)) -> None:
        self._system, self._components = system, components
        self._lock = threading.Lock()
        self._arrived = 0
        self._stops: dict[Hashable, deque[Received]] = {}
        self._queues: dict[Hashable, deque[InboxEvent]] = {}
        self._debts: dict[Hashable, int] = {}
        self.dropped = 0
        """Frames that found their link's queue full, or that waited when it ended."""

    @property
    def stops(self) -> int:
        """How many stops have arrived so far: the stamp of what arrives now."""
        return self._arrived

    @property
    def waiting(self) -> bool:
        """Whether anything waits for the next batch."""
        return bool(self._stops) or any(self._queues.values())

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
        stop = stop_asked_by(frame.message) and frame.is_for(self._system, *self._components)
        with self._lock:
            stamp = self._arrived if stops is None else stops
            self._arrived += stop
            queue = (self._stops if stop else self._queues).setdefault(via, deque())
            if len(queue) < (LARGEST_STOPS if stop else LARGEST_QUEUE):
                queue.append(Received(frame, via, stamp, now))
            else:
                self.dropped += 1

    def close(self, via: Hashable) -> None:
        """A link has ended; this comes after its waiting frames."""
        with self._lock:
            self._queues.setdefault(via, deque()).append(Closed(via))

    def take(self) -> list[InboxEvent]:
        """The events for the next batch: all stops, then as many frames of each link as its credit covers."""
        if not self._stops and not self._queues:
            return []
        with self._lock:
            events: list[InboxEvent] = [event for queue in self._stops.values() for event in queue]
            self._stops.clear()
            credit = min(CREDIT, max(ALL_CREDIT // max(len(self._queues), 1), 1))
            for via, queue in self._queues.items():
                events += map(self._marked, self._pop(via, queue, credit))
                if queue and isinstance(end := queue[-1], Closed):
                    self.dropped += len(queue) - 1
                    queue.clear()
                    events.append(end)
            self._queues = {via: queue for via, queue in self._queues.items() if queue or via in self._debts}
        return events

    def _marked(self, event: InboxEvent) -> InboxEvent:
        if isinstance(event, Received) and event.stops < self._arrived:
            return event._replace(overtaken=True)
        return event

    def _pop(self, via: Hashable, queue: deque[InboxEvent], credit: int) -> Iterator[InboxEvent]:
        """The events that a link's credit covers; the last one may cost more, which is deducted next time."""
        credit -= self._debts.pop(via, 0)
        while queue and credit > 0:
            event = queue.popleft()
            credit -= _cost(event)
            yield event
        if credit < 0:
            self._debts[via] = -credit


def _cost(event: InboxEvent) -> int:
    if not isinstance(event, Received):
        return 1
    message = event.frame.message
    if type(message) not in _COSTLY:
        return 1
    if isinstance(message, Setpoint):
        return FOLLOWED
    if isinstance(message, Goal):
        return PLANNED if message.verb != Verb.STATUS else 1
    return PLANNED if isinstance(message, _COMMANDS) and message.command in MOVING else 1


class Controller:
    """A cell with its programs.

    Args:
        cell: the world.
        firmware: the program of the first component, which answers for the whole controller.
        cameras: names of the world's cameras by their MAVLink component.
        others: the programs of its other components.
    """

    def __init__(
        self, cell: Cell, firmware: Firmware, cameras: Mapping[int, str], others: Iterable[Firmware] = ()
    ) -> None:
        self.cell, self.firmware, self.cameras = cell, firmware, cameras
        self.programs = (firmware, *others)
        self.components = tuple(each.component for each in self.programs)
        self._camera_components = [Camera(firmware.system, each, name) for each, name in cameras.items()]
        self._inbox = Inbox(firmware.system, self.components)

    @property
    def stops(self) -> int:
        """How many stops have arrived so far, on all links."""
        return self._inbox.stops

    @property
    def waiting(self) -> bool:
        """Whether anything that was posted has not been heard yet."""
        return self._inbox.waiting

    def post(self, frame: Frame, via: Hashable, stops: int | None = None) -> None:
        """Leave a frame that came over the link `via`, to be heard before the next batch. From any thread.

        A link that brings more than its share loses some; see `inbox`.

        Args:
            frame: intact.
            via: the link.
            stops: how many stops had arrived when its bytes came, if they waited since.
        """
        self._inbox.put(frame, via, stops, self.cell.time_ms)

    def greet(self, via: Hashable) -> None:
        """A link `via` was opened; who is on it is told at once what this is. From any thread."""
        self._inbox.open(via)

    def leave(self, via: Hashable) -> None:
        """The link `via` has ended. From any thread."""
        self._inbox.close(via)

    def advance(self) -> list[Outgoing]:
        """Hear what was posted, let the world go on for one batch, and say what is to be said."""
        out: list[Outgoing] = []
        now = self.cell.time_ms
        for event in self._inbox.take():
            for program in self.programs:
                out += _spoken_by(program, _take(program, event, now))
            if isinstance(event, Received):
                for camera in self._camera_components:
                    sent = camera.receive(event.frame, event.via, now / 1000)
                    out += [Outgoing(each.message, each.via, component=camera.component) for each in sent]
        self.firmware.gauges.overrun = self._inbox.dropped
        self.cell.advance()
        for program in self.programs:
            out += _spoken_by(program, program.tick(self.cell.time_ms))
        for camera in self._camera_components:
            beats = camera.tick(self.cell.time_ms / 1000)
            out += [Outgoing(each, telemetry=True, component=camera.component) for each in beats]
        return out


def _take(program: Firmware, event: InboxEvent, now: int) -> list[Outgoing]:
    if isinstance(event, Received):
        return program.receive(event.frame, event.via, now, arrived=event.arrived, overtaken=event.overtaken)
    return program.greet(event.via, now) if isinstance(event, Opened) else program.leave(event.via, now)


def _spoken_by(program: Firmware, out: list[Outgoing]) -> list[Outgoing]:
    """Return the messages of a program, with its component as the sender."""
    if program.component == COMPONENT:
        return out
    return [msgspec.structs.replace(each, component=program.component) for each in out]
