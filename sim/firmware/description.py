"""The controller's reports about itself, on request and once a second: versions, load, counters, time.

Pure; the wall clock is passed in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from robotree.protocol.messages import (
    AutopilotVersion,
    MavProtocolCapability,
    Message,
    SysStatus,
)
from robotree.protocol.services import version
from robotree.protocol.services.setpoint import SetpointStatistics

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
