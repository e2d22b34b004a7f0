"""What a system says about itself when it is asked, from common.xml and upstream's dialects."""

from __future__ import annotations

from enum import IntFlag

from robotree.protocol.messages.base import Message, wire


class MavProtocolCapability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY, as far as we need it."""

    COMMAND_INT = 8
    MAVLINK2 = 8192
    PARAM_ENCODE_C_CAST = 131072
    COMPONENT_ACCEPTS_GCS_CONTROL = 524288
    GRIPPER = 1048576


class GcsControlStatusFlags(IntFlag):
    """GCS_CONTROL_STATUS_FLAGS."""

    SYSTEM_MANAGER = 1
    TAKEOVER_ALLOWED = 2


@wire("SYS_STATUS")
class SysStatus(Message, frozen=True, gc=False):
    """Load, supply and errors."""

    onboard_control_sensors_present: int
    onboard_control_sensors_enabled: int
    onboard_control_sensors_health: int
    load: int
    """[0.1 %] of the controller's time."""
    voltage_battery: int
    """[mV]; 65535: unknown."""
    current_battery: int
    """[0.01 A]; -1: unknown."""
    battery_remaining: int
    """[%]; -1: unknown."""
    drop_rate_comm: int
    """[0.01 %]"""
    errors_comm: int
    errors_count1: int = 0
    errors_count2: int = 0
    errors_count3: int = 0
    errors_count4: int = 0
    onboard_control_sensors_present_extended: int = 0
    onboard_control_sensors_enabled_extended: int = 0
    onboard_control_sensors_health_extended: int = 0


@wire("SYSTEM_TIME")
class SystemTime(Message, frozen=True, gc=False):
    """The wall clock and the time since start."""

    time_unix_usec: int
    time_boot_ms: int


@wire("PING")
class Ping(Message, frozen=True, gc=False):
    """A question (targets 0), or its answer."""

    time_usec: int
    seq: int
    target_system: int = 0
    target_component: int = 0


@wire("AUTOPILOT_VERSION")
class AutopilotVersion(Message, frozen=True, gc=False):
    """What can be talked about, and which program talks."""

    capabilities: int
    flight_sw_version: int
    middleware_sw_version: int
    os_sw_version: int
    board_version: int
    flight_custom_version: bytes
    """(8,)"""
    middleware_custom_version: bytes
    """(8,)"""
    os_custom_version: bytes
    """(8,)"""
    vendor_id: int
    product_id: int
    uid: int
    uid2: bytes = bytes(18)
    """(18,)"""


@wire("PROTOCOL_VERSION")
class ProtocolVersion(Message, frozen=True, gc=False):
    """Which MAVLink is spoken, times 100."""

    version: int
    min_version: int
    max_version: int
    spec_version_hash: bytes = bytes(8)
    """(8,)"""
    library_version_hash: bytes = bytes(8)
    """(8,)"""


@wire("MESSAGE_INTERVAL")
class MessageInterval(Message, frozen=True, gc=False):
    """How often a message is sent."""

    message_id: int
    interval_us: int
    """[us]; -1: not at all, 0: there is no such message."""


@wire("REQUEST_DATA_STREAM")
class RequestDataStream(Message, frozen=True, gc=False):
    """The old way to ask for a rate."""

    target_system: int
    target_component: int
    req_stream_id: int
    req_message_rate: int
    """[Hz]"""
    start_stop: int


@wire("SET_MODE")
class LegacySetMode(Message, frozen=True, gc=False):
    """The old way to ask for a mode, before the command DO_SET_MODE."""

    target_system: int
    base_mode: int
    custom_mode: int


@wire("MISSION_REQUEST_LIST")
class MissionRequestList(Message, frozen=True, gc=False):
    """Asks how many mission items there are."""

    target_system: int
    target_component: int
    mission_type: int = 0


@wire("MISSION_COUNT")
class MissionCount(Message, frozen=True, gc=False):
    """How many mission items there are."""

    target_system: int
    target_component: int
    count: int
    mission_type: int = 0


@wire("CONTROL_STATUS")
class ControlStatus(Message, frozen=True, gc=False):
    """Who is in control."""

    flags: int
    gcs_main: int
    """0: nobody."""
    gcs_secondary: bytes = bytes(10)
    """(10,)"""
