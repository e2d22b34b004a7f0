"""Which frames command somebody, so that playing them again would move a robot or change it. Pure.

Whatever is addressed to a system counts, unless it is known to ask, to answer or to measure: a message that
is new, or of somebody's own dialect, is rather left out once too often.
"""

from __future__ import annotations

from robotree.protocol.capture.framing import msgid
from robotree.protocol.dialect.table import definitions

_HARMLESS = frozenset(
    {
        "PING", "COMMAND_ACK", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_ERROR",
        "PARAM_EXT_REQUEST_READ", "PARAM_EXT_REQUEST_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT",
        "MISSION_REQUEST_LIST", "MISSION_REQUEST_PARTIAL_LIST", "MISSION_ACK", "LOG_REQUEST_LIST",
        "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOGGING_DATA", "LOGGING_DATA_ACKED", "LOGGING_ACK",
        "GIMBAL_DEVICE_ATTITUDE_STATUS", "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE", "GLOBAL_POSITION_SENSOR",
        "ROBOTREE_GOAL_STATUS", "ROBOTREE_CLAIM_STATUS", "ROBOTREE_PICTURE_REQUEST",
    }
)  # fmt: skip
"""Addressed, and still no command; so is what begins with `_TOLD_TO_ALL`."""
_TOLD_TO_ALL = "OPEN_DRONE_ID_"
_ELSEWHERE = frozenset({"MANUAL_CONTROL", "SERIAL_CONTROL"})
"""Commands that name whom they are for in no field that others have, or nobody."""


def commands(frame: bytes) -> bool:
    """Whether a whole frame is of a message that commands; one of an unknown message is not known to."""
    definition = definitions().get(msgid(frame))
    if definition is None:
        return False
    name = definition.name
    if definition.target_system < 0:
        return name in _ELSEWHERE
    return name not in _HARMLESS and not name.startswith(_TOLD_TO_ALL)
