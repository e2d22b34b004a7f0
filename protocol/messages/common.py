"""The messages of common.xml that robotree speaks, and the constants they need.

Field names are the XML's, even where Python has a builtin of that name.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Any

from robotree.protocol.messages.base import Message, wire


class MavType(IntEnum):
    """MAV_TYPE, as far as we need it. There is none for an arm: an arm is GENERIC."""

    GENERIC = 0
    GCS = 6
    GROUND_ROVER = 10
    ONBOARD_CONTROLLER = 18
    CAMERA = 30
    GRIPPER = 48


class MavAutopilot(IntEnum):
    """MAV_AUTOPILOT, as far as we need it."""

    GENERIC = 0
    INVALID = 8


class MavState(IntEnum):
    """MAV_STATE."""

    UNINIT = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6
    POWEROFF = 7
    FLIGHT_TERMINATION = 8


class MavModeFlag(IntFlag):
    """MAV_MODE_FLAG, as far as we need it."""

    CUSTOM_MODE_ENABLED = 1
    HIL_ENABLED = 32
    """Nothing real moves: the controller drives a simulation."""
    SAFETY_ARMED = 128


class MavSeverity(IntEnum):
    """MAV_SEVERITY, as in RFC 5424."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class MavComponent(IntEnum):
    """MAV_COMPONENT: who speaks within a system."""

    ALL = 0
    AUTOPILOT1 = 1
    CAMERA = 100
    CAMERA2 = 101
    MISSIONPLANNER = 190
    ONBOARD_COMPUTER = 191


class DataStreamType(IntEnum):
    """MAVLINK_DATA_STREAM_TYPE, as far as we need it."""

    IMG_JPEG = 0


@wire("HEARTBEAT")
class Heartbeat(Message, frozen=True, gc=False):
    """A component is present and does well, or not."""

    type: int
    autopilot: int
    base_mode: int
    custom_mode: int
    system_status: int
    mavlink_version: int = 3


@wire("STATUSTEXT")
class Statustext(Message, frozen=True, gc=False):
    """A sentence for people, or a chunk of one."""

    severity: int
    text: str
    id: int = 0
    chunk_seq: int = 0


@wire("TIMESYNC")
class Timesync(Message, frozen=True, gc=False):
    """Question (tc1 is 0) or answer of a time synchronisation, [ns]."""

    tc1: int
    ts1: int


@wire("LOCAL_POSITION_NED")
class LocalPositionNed(Message, frozen=True, gc=False):
    """Position [m] and velocity [m/s] of a mobile base."""

    time_boot_ms: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float


@wire("NAMED_VALUE_FLOAT")
class NamedValueFloat(Message, frozen=True, gc=False):
    """A number with a name of at most 10 bytes."""

    time_boot_ms: int
    name: str
    value: float


@wire("DATA_TRANSMISSION_HANDSHAKE")
class DataTransmissionHandshake(Message, frozen=True, gc=False):
    """Announces a picture that follows in `packets` messages ENCAPSULATED_DATA."""

    type: int
    size: int
    width: int
    height: int
    packets: int
    payload: int
    jpg_quality: int


@wire("ENCAPSULATED_DATA")
class EncapsulatedData(Message, frozen=True, gc=False):
    """A piece of a picture."""

    seqnr: int
    data: bytes
    """At most 253 bytes; the wire pads with zeros."""


@wire("SETUP_SIGNING")
class SetupSigning(Message, frozen=True, gc=False):
    """Hands out a signing key, in the clear. Its text never shows the key."""

    target_system: int
    target_component: int
    secret_key: bytes
    initial_timestamp: int

    def __repr__(self) -> str:
        return (
            f"SetupSigning(target_system={self.target_system}, target_component={self.target_component}, ...)"
        )

    def __rich_repr__(self) -> list[tuple[str, Any]]:  # msgspec's would show every field
        return [("target_system", self.target_system), ("target_component", self.target_component)]
