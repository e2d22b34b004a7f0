"""In which frame coordinates are: of robots that share a plan, and of the points that a camera sees. Pure.

Frames: W is the frame of the cell, in which robots are commanded (x forward, y left, z up). The camera's
frame is the optical one of ROS REP 103: x to the right of the picture, y down, z along the view. Where the
camera was, and its field of view, come with each picture (`CameraLens`), from the controller that took it;
nothing about a camera is known here: it is a pinhole.

A pixel alone is a ray, not a point: what is meant is where the ray meets a level plane z = height. A thing
that stands higher hides what is behind it, so what is clicked on its side means a point behind it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.tui.seen.store import Store
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.requests import CameraLens

FRAME, CONTROLLER = "frame", "controller"
"""Attributes of a robot: the name of the frame of its coordinates, or of its controller, whose W it is."""
BODY = "/body"
"""Ends the name of a frame that moves with the base of the same controller."""


def frame_of(robot: RobotDescription) -> str:
    """Return the name of the frame in which a robot's coordinates are; empty: it does not say."""
    return robot.attributes.get(FRAME) or robot.attributes.get(CONTROLLER, "")


def frames_below(robot: RobotDescription, robots: Mapping[str, RobotDescription]) -> set[str]:
    """Return the frames of a robot and of those that it commands, by their names."""
    found, seen, waiting = set[str](), set[str](), [robot]
    while waiting:
        one = waiting.pop()
        if one.name in seen:
            continue
        seen.add(one.name)
        if frame := frame_of(one):
            found.add(frame)
        children = (each for slot in one.slots if (each := slot.child or slot.watched))
        waiting += [robots[child.name] for child in children if child.name in robots]
    return found


class Spot(NamedTuple):
    """Where a robot is, in the frame of a plan."""

    name: str
    x: float
    y: float
    heading: float | None = None
    """[rad] counterclockwise from x; None: it does not tell any."""


def ground_of(robot: RobotDescription | None, robots: Mapping[str, RobotDescription] | None = None) -> str:
    """Return the frame of the plan on which a robot is shown: of a limb that of the floor below it.

    A robot that names none is where those of `robots` are that it commands.
    """
    if robot is None:
        return ""
    return (frame_of(robot) or min(frames_below(robot, robots or {}), default="")).removesuffix(BODY)


def spots(store: Store, ground: str) -> list[Spot]:
    """Return where the robots of a frame are, by what they read now; limbs go with their base."""
    found: list[Spot] = []
    carried: list[tuple[str, float, float]] = []
    bodies: list[Mapping[str, float]] = []
    for name, robot in store.descriptions.items():
        frame = frame_of(robot)
        if frame.removesuffix(BODY) != ground:
            continue
        state = store.state(name)
        readings = robot.readings if state is None else state.readings
        if not ("x" in readings and "y" in readings):
            continue
        if frame.endswith(BODY):
            carried.append((name, readings["x"], readings["y"]))
            continue
        if "heading" in readings:
            bodies.append(readings)
        found.append(Spot(name, readings["x"], readings["y"], readings.get("heading")))
    return found + _placed(carried, bodies)


def _placed(carried: Iterable[tuple[str, float, float]], bodies: list[Mapping[str, float]]) -> list[Spot]:
    from robotree.tui.seen.plan import carried as carried_point

    body = bodies[0] if len(bodies) == 1 else None
    at = ((name, carried_point(x, y, body)) for name, x, y in carried)
    return [Spot(name, *point) for name, point in at if point is not None]


Point = tuple[float, float, float]
"""[m] x, y, z in W."""

LEVEL = 0.05
"""[m] by which one press of a key raises the plane that is pointed at."""
FARTHEST = 50.0
"""[m] from the camera: a ray that meets the plane beyond is one towards the horizon."""


def rotated(lens: CameraLens, vector: Point) -> Point:
    """Return a vector of the camera's frame along the axes of W."""
    w, x, y, z = lens.qw, lens.qx, lens.qy, lens.qz
    scale = 2.0 / (w * w + x * x + y * y + z * z)
    a, b, c = vector
    # v + 2 q x (q x v + w v), for a quaternion of any length
    ux, uy, uz = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    return (
        a + scale * (y * uz - z * uy),
        b + scale * (z * ux - x * uz),
        c + scale * (x * uy - y * ux),
    )


def ray(lens: CameraLens, across: float, down: float, aspect: float) -> Point:
    """Return the direction in W of what is seen at a place of a picture.

    Args:
        lens: of the camera.
        across: 0 at the left edge of the picture, 1 at the right one.
        down: 0 at the upper edge, 1 at the lower one.
        aspect: width of the picture over its height.

    Returns:
        A vector of no certain length, away from the camera.
    """
    half = math.tan(lens.fovy / 2.0)
    return rotated(lens, ((2.0 * across - 1.0) * half * aspect, (2.0 * down - 1.0) * half, 1.0))


def on_plane(
    lens: CameraLens, across: float, down: float, aspect: float, height: float = 0.0
) -> Point | None:
    """Return where what is seen at a place of a picture meets the plane z = height [m].

    Args:
        lens: of the camera.
        across: as in `ray`.
        down: as in `ray`.
        aspect: as in `ray`.
        height: [m] of the plane in W.

    Returns:
        The point [m], in W; None: the plane is behind the camera there, or beyond `FARTHEST`.
    """
    dx, dy, dz = ray(lens, across, down, aspect)
    if not dz:
        return None
    along = (height - lens.z) / dz
    if not 0.0 < along * math.hypot(dx, dy, dz) < FARTHEST:
        return None
    return lens.x + along * dx, lens.y + along * dy, height


def seen_at(lens: CameraLens, point: Point, aspect: float) -> tuple[float, float] | None:
    """Return where in a picture a point of W is seen: across and down as in `ray`, also outside 0 to 1.

    None: it is behind the camera.
    """
    inverse = (point[0] - lens.x, point[1] - lens.y, point[2] - lens.z)
    right, downward, ahead = (rotated(lens, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    x, y, z = (sum(a * b for a, b in zip(axis, inverse, strict=True)) for axis in (right, downward, ahead))
    if z <= 1e-6:  # at the camera itself
        return None
    half = math.tan(lens.fovy / 2.0)
    return (x / (z * half * aspect) + 1.0) / 2.0, (y / (z * half) + 1.0) / 2.0
