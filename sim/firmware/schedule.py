"""Which telemetry is due on which link: every link has rates of its own.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Collection, Hashable, Mapping, Sequence
from typing import Final

from robotree.protocol.messages import Message, NamedValueFloat
from robotree.protocol.services.interval import Intervals
from robotree.sim.firmware.outgoing import Outgoing
from robotree.sim.firmware.telemetry import Stream, boot_ms

FASTEST: Final = 0.005
"""[s] between two messages of a kind: one batch of the physics."""


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

    def read(self, msgid: int, now: int, *, busy: bool) -> Sequence[Message]:
        """One reading of what a message tells; nothing if there is no such telemetry."""
        stream = self._streams.get(msgid)
        return () if stream is None else stream.read(boot_ms(now), busy)

    def tick(self, now: int, *, busy: bool) -> list[Outgoing]:
        """What is due, for the links that it is due on; read once for all of them."""
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
    """What tells telemetry of one kind apart: the name of a named value."""
    return message.name if isinstance(message, NamedValueFloat) else None
