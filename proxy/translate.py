"""Conversions between agents and wire: keys and deadlines of goals, telemetry into readings. Pure.

How a kind's motions are encoded, the motions know themselves (`motion`).

Two frames meet here. Commands, readings and robotree's own messages are in W (x forward, y left, z up); only
LOCAL_POSITION_NED is, by MAVLink's definition, north, east, down: W turned by half a turn about x.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from robotree.protocol.messages import AnyMessage, Gripper, Joints, LocalPositionNed, NamedValueFloat, Tool

FOREVER = 0.0
"""Time to live of a goal without a deadline."""
SHORTEST, LONGEST = 0.001, (2**32 - 1) / 1000.0
"""[s] Range of a time to live on the wire: whole milliseconds in 32 bits, and 0 means without end."""


class Target(NamedTuple):
    """The receiver of a message."""

    system: int
    component: int


COMPONENTS = range(25, 100)
"""Component ids that MAVLink leaves to its users (MAV_COMP_ID_USER1 to 75). No ground station has them."""


def component_of(name: str) -> int:
    """The component id of a robot's proxy, one of `COMPONENTS`.

    It follows from the robot's name, so that the controller recognises the next incarnation of the proxy as
    the sender of the same goals. Two names may have the same one; their claims differ.
    """
    digest = hashlib.blake2b(name.encode(), digest_size=4, person=b"robotree comp").digest()
    return COMPONENTS[int.from_bytes(digest, "little") % len(COMPONENTS)]


def goal_key(command_key: str, number: int = 0) -> int:
    """The 64-bit key of a goal that a command sends.

    A pure function: a command that is sent again, even by a later incarnation of the proxy, asks for the same
    goals as before, and the controller repeats their status and not the movements.

    Args:
        command_key: of the command.
        number: of goals that the command has sent before this one.
    """
    salt = number.to_bytes(8, "little")
    digest = hashlib.blake2b(command_key.encode(), digest_size=8, salt=salt, person=b"robotree goal").digest()
    return int.from_bytes(digest, "little") or 1


def time_to_live(remaining: float) -> float:
    """Time to live for the wire.

    Args:
        remaining: [s] until the deadline; infinite: none.

    Returns:
        [s], within SHORTEST and LONGEST if there is a deadline, else FOREVER.
    """
    return FOREVER if math.isinf(remaining) else max(SHORTEST, min(LONGEST, remaining))


# -- telemetry -------------------------------------------------------------------------------------


def twist_of(q: tuple[int, ...]) -> float:
    """The twist of a tool that points down.

    Args:
        q: (4,) orientation R_WT as a quaternion w, x, y, z of any length.

    Returns:
        Angle about the vertical [rad], -pi to pi; R_WT = Rz(twist) Ry(pi).
    """
    w, x, y, z = q
    squared = w * w + x * x + y * y + z * z
    if not squared:
        return 0.0
    r01 = 2.0 * (x * y - w * z) / squared
    r11 = 1.0 - 2.0 * (x * x + z * z) / squared
    return math.atan2(-r01, r11)


def _tool(m: Tool) -> dict[str, float]:
    pose = {"x": m.x, "y": m.y, "z": m.z, "twist": twist_of(m.q)}
    wrench = {"fx": m.fx, "fy": m.fy, "fz": m.fz, "tx": m.tx, "ty": m.ty, "tz": m.tz}
    return pose | wrench


def _gripper(m: Gripper) -> dict[str, float]:
    return {"width": m.width, "grip_force": m.force}


def _joints(m: Joints) -> dict[str, float]:
    return {f"j{i}": angle for i, angle in enumerate(m.position[: m.count], 1)}


def _base(m: LocalPositionNed) -> dict[str, float]:
    return {"x": m.x, "y": -m.y, "vx": m.vx, "vy": -m.vy}


LONG_NAMES = {"peak_f": "peak_force"}
"""Names that the wire shortens to ten letters."""


def _named(m: NamedValueFloat) -> dict[str, float]:
    return {LONG_NAMES.get(m.name, m.name): m.value} if m.name else {}


MessageReaders = Mapping[type[Any], Callable[[Any], dict[str, float]]]

READERS: MessageReaders = {
    Tool: _tool,
    Gripper: _gripper,
    Joints: _joints,
    LocalPositionNed: _base,
    NamedValueFloat: _named,
}
"""How each telemetry message is read, in SI units and W. A kind may have readers of its own."""


UNITS: Mapping[str, str] = {
    **dict.fromkeys(("x", "y", "z", "width"), "m"),
    **dict.fromkeys(("vx", "vy"), "m/s"),
    **dict.fromkeys(("fx", "fy", "fz", "grip_force", "peak_force"), "N"),
    **dict.fromkeys(("tx", "ty", "tz"), "N m"),
    **dict.fromkeys(("twist", "lever"), "rad"),
    **{f"j{i}": "rad" for i in range(1, 9)},
    "age": "s",
}
"""Unit of each reading, by its name. NAMED_VALUE_FLOAT has none on the wire, so those of `lever` and
`peak_force` are set here. A kind with its own readers may set its own units."""


def readings_of(message: AnyMessage, readers: MessageReaders = READERS) -> dict[str, float]:
    """The readings in a message; empty when it is no telemetry. Numbers that are not finite are left out."""
    read = readers.get(type(message))
    return {} if read is None else {n: v for n, v in read(message).items() if math.isfinite(v)}
