"""Telemetry: what a robot reports, and how often, on each link.

Times are controller time, so a stream keeps its rate per simulated second. Pure.
"""

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from math import inf
from typing import Final, NamedTuple

from robotree.protocol.messages import Message, NamedValueFloat
from robotree.protocol.services.interval import Intervals
from robotree.sim.firmware.outgoing import Outgoing

HOT: Final = 20
"""[ms] between two poses: 50 Hz."""
WARM: Final = 100
"""[ms] between two readings of what changes slowly: 10 Hz."""
FASTEST: Final = 0.005
"""[s] between two messages of a kind: one batch of the physics."""
_WORD: Final = 0xFFFFFFFF


def boot_ms(now: int) -> int:
    """Controller time [ms] as messages hold it: it begins anew every 49.7 days, as MAVLink's does."""
    return now & _WORD


class Stream(NamedTuple):
    """Messages of one kind.

    Attributes:
        kind: of message.
        period: [ms] between two, unless a client asks for another; None: only when asked for.
        read: the messages of one reading, at controller time [ms] as messages hold it, and told whether
            something moves.
    """

    kind: type[Message]
    period: int | None
    read: Callable[[int, bool], Sequence[Message]]

    @property
    def msgid(self) -> int:
        """Of its kind, on the wire."""
        return self.kind.codec.definition.id


class Schedule:
    """The telemetry of one controller.

    Args:
        streams: what can be sent, and how often it is unless somebody asks otherwise.
        fixed: the intervals [s] of what others send, by message id; told, never changed.
    """

    def __init__(self, streams: Sequence[Stream], fixed: Mapping[int, float]) -> None:
        self._streams = {stream.msgid: stream for stream in streams}
        self._defaults = {
            msgid: None if stream.period is None else stream.period / 1000
            for msgid, stream in self._streams.items()
        }
        self._fixed = fixed
        self._links: dict[Hashable, Intervals] = {}

    @property
    def links(self) -> Collection[Hashable]:
        """The links that are open."""
        return self._links.keys()

    def open(self, via: Hashable) -> Intervals:
        """The rates of a link, which is opened if it is new."""
        if (rates := self._links.get(via)) is None:
            rates = self._links[via] = Intervals(self._defaults, FASTEST, self._fixed)
        return rates

    def close(self, via: Hashable) -> None:
        """A link ended."""
        self._links.pop(via, None)

    @property
    def due(self) -> float:
        """When to call `tick` next, in controller time [s]."""
        due = inf
        for rates in self._links.values():
            due = min(due, rates.next)
        return due

    def read(self, msgid: int, now: int, *, busy: bool) -> Sequence[Message]:
        """One reading of a message; nothing if there is no such telemetry."""
        stream = self._streams.get(msgid)
        return () if stream is None else stream.read(boot_ms(now), busy)

    def tick(self, now: int, *, busy: bool) -> list[Outgoing]:
        """Return the messages that are due, for the links on which they are; read once for all of them."""
        out: list[Outgoing] = []
        readings: dict[int, list[tuple[Message, Hashable]]] = {}
        for via, rates in self._links.items():
            for msgid in rates.due(now / 1000):
                if (reading := readings.get(msgid)) is None:
                    messages = self._streams[msgid].read(boot_ms(now), busy)
                    reading = readings[msgid] = [(message, _instance(message)) for message in messages]
                out += [Outgoing(message, via, True, instance) for message, instance in reading]
        return out


def _instance(message: Message) -> Hashable:
    """The key among telemetry of one kind: the name of a named value."""
    return message.name if isinstance(message, NamedValueFloat) else None
