"""Our telemetry for Foxglove: poses, frame transforms and joints in its own schemas. Pure.

Foxglove's panels know a message by the name of its schema, in JSON too, whose schemas are given here
(https://docs.foxglove.dev/docs/visualization/message-schemas: PoseInFrame, FrameTransforms, JointStates;
times are sec and nsec). The frame of all is `world`, our W: metres, x forward, y left, z up.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from robotree.protocol.messages import Joints, LocalPositionNed, Tool

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robotree.protocol.frame import Frame

WORLD: Final = "world"
_NUMBER: Final = {"type": "number"}
_TEXT: Final = {"type": "string"}


def _object(title: str = "", **properties: Mapping[str, Any]) -> dict[str, Any]:
    return ({"title": title} if title else {}) | {"type": "object", "properties": properties}


_TIME: Final = _object("time", sec={"type": "integer"}, nsec={"type": "integer"})
_VECTOR: Final = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_TRANSFORM: Final = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
_JOINT: Final = _object("foxglove.JointState", name=_TEXT, position=_NUMBER)
SCHEMAS: Final[Mapping[str, Mapping[str, Any]]] = {
    "foxglove.PoseInFrame": _object(
        "foxglove.PoseInFrame",
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION),
    ),
    "foxglove.FrameTransforms": _object(
        "foxglove.FrameTransforms", transforms={"type": "array", "items": _TRANSFORM}
    ),
    "foxglove.JointStates": _object(
        "foxglove.JointStates", timestamp=_TIME, joints={"type": "array", "items": _JOINT}
    ),
}
"""By name, as Foxglove has them."""


class View(NamedTuple):
    """One message for Foxglove."""

    topic: str
    schema: str
    """Its name, one of `SCHEMAS`."""
    data: dict[str, Any]


def views(frame: Frame, nanoseconds: int) -> list[View]:
    """Return what a frame shows, at a moment [ns] since 1970; nothing: it is no place and no posture."""
    message, where = frame.message, f"/{frame.system}/{frame.component}"
    time = {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}
    match message:
        case Tool():
            w, x, y, z = (each / 32767 for each in message.q)
            turned = {"x": x, "y": y, "z": z, "w": w}
            return _placed(f"{where}/tool", time, (message.x, message.y, message.z), turned)
        case LocalPositionNed():  # NED has y to the right and z down
            straight = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
            return _placed(f"{where}/base", time, (message.x, -message.y, -message.z), straight)
        case Joints():
            angles = message.position[: message.count]
            joints = [
                {"name": f"joint_{number}", "position": angle}
                for number, angle in enumerate(angles, 1)
                if math.isfinite(angle)
            ]
            return [View(f"{where}/joints", "foxglove.JointStates", {"timestamp": time, "joints": joints})]
        case _:
            return []


def _placed(
    topic: str, time: dict[str, int], place: tuple[float, float, float], turned: dict[str, float]
) -> list[View]:
    """A pose, and the frame that stands there; it is named as its topic."""
    if not all(map(math.isfinite, place)):
        return []
    position = dict(zip("xyz", place, strict=True))
    pose = {"position": position, "orientation": turned}
    transform = {
        "timestamp": time,
        "parent_frame_id": WORLD,
        "child_frame_id": topic.strip("/"),
        "translation": position,
        "rotation": turned,
    }
    return [
        View(topic, "foxglove.PoseInFrame", {"timestamp": time, "frame_id": WORLD, "pose": pose}),
        View("/tf", "foxglove.FrameTransforms", {"transforms": [transform]}),
    ]
