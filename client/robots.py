"""The robots of a realm as a program gets them: short in a notebook, and printed as trees. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

from robotree.vr.base.description import Listing, RobotDescription, SlotSpec

_T = TypeVar("_T", Listing, RobotDescription)

MOST = 12
"""Names that are shown in one line."""


class Robots(tuple[_T, ...]):
    """Robots, each with `name`, `kind` and more. `print` draws parents above their children."""

    __slots__ = ()

    def __repr__(self) -> str:
        names = ", ".join(robot.name for robot in self[:MOST])
        return f"<{len(self)} robots{': ' if self else ''}{names}{' …' if len(self) > MOST else ''}>"

    def __str__(self) -> str:
        known = {robot.address.key: robot for robot in self}
        children = {slot.child.key for robot in self for slot in _slots(robot) if slot.child}
        roots = [robot for key, robot in known.items() if key not in children]
        return "\n".join(line for root in roots for line in _lines(root, known, "", ""))


def _slots(robot: Listing | RobotDescription) -> Sequence[SlotSpec]:
    """Return the places for children; a listing does not name them."""
    return robot.slots if isinstance(robot, RobotDescription) else ()


def _lines(
    robot: Listing | RobotDescription, known: Mapping[str, Listing | RobotDescription], lead: str, below: str
) -> Iterator[str]:
    """Draw a robot and all below it; a circle of parents, which is a fault, has no root and is not drawn."""
    yield f"{lead}{robot.name} ({robot.kind})"
    slots = _slots(robot)
    for number, slot in enumerate(slots, 1):
        elbow, bar = ("└─ ", "   ") if number == len(slots) else ("├─ ", "│  ")
        place = f"{below}{elbow}{slot.name}: "
        child = known.get(slot.child.key) if slot.child else None
        if child is not None:
            yield from _lines(child, known, place, below + bar)
        elif slot.child:
            yield f"{place}{slot.child.name} (does not answer)"
        elif slot.watched:
            yield f"{place}watches {slot.watched.name}"
        else:
            yield f"{place}empty ({slot.kind})"
