"""Telemetry: what a robot reports, and how often, on each link. Versions, load and counters are among it.

Times are controller time, so a stream keeps its rate per simulated second. Pure; the wall clock is passed in.
"""

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple, Protocol

from robotree.protocol.messages import (
    AutopilotVersion,
    MavProtocolCapability,
    Message,
    NamedValueFloat,
    SysStatus,
)
from robotree.protocol.services import version
from robotree.protocol.services.interval import Intervals
from robotree.protocol.services.setpoint import SetpointStatistics
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


UNKNOWN_VOLTAGE: Final = 0xFFFF
NOTHING_MORE: Final = MavProtocolCapability(0)
_LARGEST: Final = 0xFFFF


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Which controller this is.

    Attributes:
        version: of its program, as 1.2.3.
        uid: 64 bits that tell it from others; not 0.
        capabilities: what this kind offers beyond every controller of ours.
        wall: Unix time [s]; 0: unknown.
        life: another number after each start, 1 to 65535.
    """

    version: str = "0.0.0"
    uid: int = 1
    capabilities: MavProtocolCapability = NOTHING_MORE
    wall: Callable[[], float] = lambda: 0.0
    life: int = 1


class Source(Protocol):
    """A battery."""

    @property
    def voltage(self) -> float:
        """Between its poles [V]."""
        ...

    @property
    def current(self) -> float:
        """[A] out of it."""
        ...

    @property
    def charge(self) -> float:
        """Share, 0 to 1."""
        ...


class Gauges:
    """The counters and measurements of the program that runs the firmware.

    Args:
        battery: that feeds the robot; None: it runs on mains power.
    """

    def __init__(self, battery: Source | None = None) -> None:
        self.battery = battery
        self.load = 0.0
        """Share of the time of a batch that computing it takes."""
        self.overrun = 0
        """Frames that were dropped because their link brought more than the controller hears."""
        self.lost = 0
        """Datagrams that were lost unread because their link brought more than its share."""
        self.garbled = 0
        """The frames from the links that were damaged, unknown, or not signed as they must be."""


def autopilot_version(identity: Identity) -> AutopilotVersion:
    """Which program this is."""
    return version.autopilot_version(
        identity.version, identity.uid, version.CAPABILITIES | identity.capabilities
    )


def sys_status(gauges: Gauges, setpoints: SetpointStatistics) -> Message:
    """Load, counters and battery.

    `errors_comm` counts what the links brought and was not accepted: frames beyond the share of one link,
    what was lost unread, and what was no frame, unknown, or not signed as it must be; `errors_count1` to
    `errors_count4` count set-points: late, of an old epoch, overtaken, refused or of an ended stream.
    """
    counts = (setpoints.late, setpoints.stale, setpoints.overtaken, setpoints.refused + setpoints.ended)
    return SysStatus(
        0,
        0,
        0,
        min(round(1000 * gauges.load), _LARGEST),
        *_battery(gauges.battery),
        0,
        min(gauges.overrun + gauges.lost + gauges.garbled, _LARGEST),
        *(min(count, _LARGEST) for count in counts),
    )


def _battery(source: Source | None) -> tuple[int, int, int]:
    """Voltage [mV], current [cA] and what is left [%], each as SYS_STATUS says that it is not known."""
    if source is None:
        return UNKNOWN_VOLTAGE, -1, -1
    return round(1000 * source.voltage), round(100 * source.current), round(100 * source.charge)
