"""As whom the verbs speak that ask something of a robot."""

from __future__ import annotations

SYSTEM = 255
"""The system of ground stations."""
COMPONENT = 155
"""MAV_COMP_ID_LOG. A voice of its own: a controller that waits for its commander must not take us for it."""
