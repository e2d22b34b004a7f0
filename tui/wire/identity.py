"""The MAVLink ids of the verbs that ask something of a robot."""

from __future__ import annotations

from robotree.protocol.messages import Heartbeat, MavAutopilot, MavState, MavType

SYSTEM = 255
"""The system of ground stations."""
COMPONENT = 155
"""MAV_COMP_ID_LOG. A voice of its own: a controller that waits for its commander must not take us for it."""


def heartbeat() -> Heartbeat:
    """The heartbeat that shows listeners on a port or a bus that we are there."""
    return Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
