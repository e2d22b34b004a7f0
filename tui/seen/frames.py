"""In which frame a robot's coordinates are: robots that share one are on one plan. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.tui.seen.store import Store
    from robotree.vr.base.description import RobotDescription

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
