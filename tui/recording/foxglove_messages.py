"""Messages of Foxglove's own schemas, for recordings and for `robotree foxglove`. Pure.

Each robot whose readings have `x` and `y` [m] has a transform in the frame of its coordinates (`frame_of`):
W of its controller, or what it names. Limbs are in the frame of the body that carries them, where the robot
with a `heading` is. Frames of two controllers are not joined: nobody has said where one stands in the
other.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from robotree.tui.seen.frames import BODY, frame_of

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.requests import LoggedLine, Picture

WORLD: Final = "world"
"""The frame of robots that name none."""

TRANSFORMS: Final = "/tf"
"""The topic of `foxglove.FrameTransforms`."""

LEVELS: Final = {"debug": 1, "warning": 3, "cancelled": 3, "error": 4, "failed": 4}
"""Levels of `foxglove.Log`; all others are INFO, 2."""

_TEXT: Final = {"type": "string"}


def _record(**properties: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"type": "object", "properties": properties}


def _numbers(names: str) -> Mapping[str, Any]:
    return _record(**{name: {"type": "number"} for name in names})


_TIME: Final = _record(sec={"type": "integer"}, nsec={"type": "integer"})
_TRANSFORM: Final = _record(
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_numbers("xyz"),
    rotation=_numbers("xyzw"),
)
SCHEMAS: Final[Mapping[str, Mapping[str, Any]]] = {
    "foxglove.Log": _record(
        timestamp=_TIME,
        level={"type": "integer"},
        message=_TEXT,
        name=_TEXT,
        file=_TEXT,
        line={"type": "integer"},
    ),
    "foxglove.CompressedImage": _record(
        timestamp=_TIME, frame_id=_TEXT, data={"type": "string", "contentEncoding": "base64"}, format=_TEXT
    ),
    "foxglove.FrameTransforms": _record(transforms={"type": "array", "items": _TRANSFORM}),
}
"""As https://docs.foxglove.dev/docs/visualization/message-schemas has them."""


def stamp(unix: float) -> dict[str, int]:
    """Return a time [s since 1970]."""
    nanoseconds = round(unix * 1e9)
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


def log(name: str, line: LoggedLine) -> dict[str, Any]:
    """Return a line of an agent's log, as `foxglove.Log`."""
    level = LEVELS.get(line.level, 2)
    said = {"timestamp": stamp(line.unix), "level": level, "message": line.text, "name": name}
    return {**said, "file": "", "line": 0}


def image(unix: float, picture: Picture) -> dict[str, Any]:
    """Return a picture, as `foxglove.CompressedImage`."""
    data = base64.b64encode(picture.jpeg).decode()
    return {"timestamp": stamp(unix), "frame_id": picture.camera, "data": data, "format": "jpeg"}


def transforms(
    name: str, readings: Mapping[str, float], robot: RobotDescription | None, unix: float
) -> dict[str, Any] | None:
    """Return where a robot is, as `foxglove.FrameTransforms`; None: it says nothing of that.

    Args:
        name: of the robot, and of its frame.
        readings: its place `x`, `y`, `z` [m], and its turn about the vertical, `heading` or `twist` [rad].
        robot: its description; None: not known.
        unix: [s] since 1970 when it was read.
    """
    if not {"x", "y"} <= readings.keys():
        return None
    half = readings.get("heading", readings.get("twist", 0.0)) / 2.0
    frame = (robot and frame_of(robot)) or WORLD
    children = [name]
    if "heading" in readings and frame != WORLD:
        children.append(f"{frame}{BODY}")
    there = {
        "timestamp": stamp(unix),
        "parent_frame_id": frame,
        "translation": {"x": readings["x"], "y": readings["y"], "z": readings.get("z", 0.0)},
        "rotation": {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)},
    }
    return {"transforms": [{**there, "child_frame_id": child} for child in children]}
