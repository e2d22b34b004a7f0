"""AUTOPILOT_VERSION and PROTOCOL_VERSION: which program this is, and what it supports."""

from __future__ import annotations

import re

from robotree.protocol.messages import AutopilotVersion, MavProtocolCapability, ProtocolVersion

CAPABILITIES = (
    MavProtocolCapability.MAVLINK2
    | MavProtocolCapability.COMMAND_INT
    | MavProtocolCapability.FTP
    | MavProtocolCapability.FLIGHT_TERMINATION
    | MavProtocolCapability.PARAM_ENCODE_C_CAST
    | MavProtocolCapability.COMPONENT_ACCEPTS_GCS_CONTROL
)
"""The capabilities of every controller of ours."""
_MAVLINK_1, _MAVLINK_2 = 100, 200
_KINDS = {"dev": 0, "a": 64, "b": 128, "rc": 192, "": 255}
"""FIRMWARE_VERSION_TYPE."""
_VERSION = re.compile(r"(\d+)(?:\.(\d+))?(?:\.(\d+))?[.-]?(dev|rc|a|b)?")


def packed(version: str) -> int:
    """A version such as 1.2.3rc1 in the four bytes of the wire: major, minor, patch, kind; 0: it is none.

    >>> hex(packed("1.2.3")), hex(packed("0.1.0.dev4"))
    ('0x10203ff', '0x10000')
    """
    if (found := _VERSION.match(version)) is None:
        return 0
    major, minor, patch = (min(int(each or 0), 255) for each in found.group(1, 2, 3))
    return major << 24 | minor << 16 | patch << 8 | _KINDS[found.group(4) or ""]


def autopilot_version(
    version: str, uid: int, capabilities: MavProtocolCapability = CAPABILITIES
) -> AutopilotVersion:
    """The description of a controller.

    Args:
        version: of its program.
        uid: identifies it, 64 bits; not 0.
        capabilities: what it offers.
    """
    return AutopilotVersion(
        capabilities=capabilities,
        flight_sw_version=packed(version),
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=bytes(8),
        middleware_custom_version=bytes(8),
        os_custom_version=bytes(8),
        vendor_id=0,
        product_id=0,
        uid=uid,
    )


def protocol_version() -> ProtocolVersion:
    """We speak MAVLink 2, and understand 1."""
    return ProtocolVersion(version=_MAVLINK_2, min_version=_MAVLINK_1, max_version=_MAVLINK_2)
