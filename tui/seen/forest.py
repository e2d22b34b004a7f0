"""The robots as trees: parents above their children, free robots at the roots. Pure.

lever (OpenCloseLever)
└─ mover: move-1 (MoveTo)
   └─ arm: arm-1 (Arm) busy: go_to
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from robotree.tui.seen import status, wording

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import RobotDescription, SlotSpec
    from robotree.vr.supervision.realm_client import Elsewhere


class _Seen(NamedTuple):
    """What `forest` is given."""

    known: Mapping[str, RobotDescription]
    hanging: Collection[str]
    unheard: Mapping[str, str]
    elsewhere: Mapping[str, Elsewhere]


@dataclass(frozen=True, slots=True)
class Branch:
    """One place in a tree: a robot, or an empty slot that waits for one."""

    slot: SlotSpec | None
    """The slot of the robot above that this one is in; None at a root."""
    robot: RobotDescription | None
    """None: the slot is empty, or its child does not answer."""
    state: str = ""
    """How the robot is, or the one that was lost there and hangs."""
    place: Elsewhere | None = None
    """Where it is, of a robot of another site."""
    branches: tuple[Branch, ...] = ()
    back: str = ""
    """How the robot is now that was lost in this empty slot, if it is there again."""

    @property
    def name(self) -> str:
        """Name of the robot, also of a child that does not answer; empty for an empty slot."""
        if self.robot:
            return self.robot.name
        return self.slot.child.name if self.slot and self.slot.child else ""


def forest(
    robots: Iterable[RobotDescription],
    hanging: Collection[str] = (),
    unheard: Mapping[str, str] | None = None,
    elsewhere: Mapping[str, Elsewhere] | None = None,
) -> tuple[Branch, ...]:
    """Plant the trees.

    Args:
        robots: all that answered, in any order.
        hanging: names of robots that hang.
        unheard: how robots are that have not answered, by name.
        elsewhere: where robots of other sites are, by name.

    Returns:
        The roots by name: robots that are nobody's child. A robot whose parent is unknown is a root too,
        so that none is lost from sight.
    """
    known = {robot.address.key: robot for robot in sorted(robots, key=lambda one: one.name)}
    children = {slot.child.key for robot in known.values() for slot in robot.slots if slot.child}
    planted: set[str] = set()
    seen = _Seen(known, hanging, unheard or {}, elsewhere or {})
    grow = partial(_grow, seen=seen, planted=planted)
    roots = [grow(None, robot) for key, robot in known.items() if key not in children]
    # The rest is a circle of parents: a fault, which must be seen.
    roots += [grow(None, robot) for key, robot in known.items() if key not in planted]
    return tuple(roots)


def _grow(
    slot: SlotSpec | None,
    robot: RobotDescription | None,
    seen: _Seen,
    planted: set[str],
) -> Branch:
    if robot is None:
        child = slot.child.name if slot and slot.child else ""
        lost = f"{slot.was} hangs" if slot and slot.was in seen.hanging else ""
        state = seen.unheard.get(child, "does not answer") if child else lost
        return Branch(slot, None, state, place=seen.elsewhere.get(child), back=_back(slot, seen))
    state, place = status.text(robot, hanging=seen.hanging), seen.elsewhere.get(robot.name)
    if robot.address.key in planted:
        return Branch(slot, robot, state, place=place)
    planted.add(robot.address.key)
    inner = [
        _grow(one, seen.known.get(one.child.key) if one.child else None, seen, planted) for one in robot.slots
    ]
    return Branch(slot, robot, state, place, tuple(inner))


def _back(slot: SlotSpec | None, seen: _Seen) -> str:
    """Return how a robot is that was lost in a slot and is there again, as a clause; empty: none is."""
    was = slot.was if slot and not slot.child and slot.was not in seen.hanging else ""
    robot = next((robot for robot in seen.known.values() if was and robot.name == was), None)
    if robot is None:
        return ""
    return f"{was} was lost, and is {f'now in {robot.bond.parent.name}' if robot.bond else 'free again'}"


def drawing(roots: Iterable[Branch]) -> str:
    """Draw the trees as text."""
    return "\n".join(line for root in roots for line in _lines(root, "", ""))


def names(branch: Branch) -> Iterable[str]:
    """Return the names of all robots of a tree, from the top."""
    if branch.name:
        yield branch.name
    for one in branch.branches:
        yield from names(one)


def label(branch: Branch) -> str:
    """Return one line for a branch, without its lead."""
    place = f"{branch.slot.name}: " if branch.slot else ""
    if branch.robot:
        shown = "" if status.status_of(branch.robot) in status.CALM else f"  {branch.state}"
        link = f"  {status.UNGUARDED}" if branch.robot.unguarded else ""
        kind = wording.inserted(branch.robot.kind, branch.robot.attributes)
        flows = [f"{one.name} {traffic}" for one in branch.robot.streams if (traffic := wording.traffic(one))]
        sends = f"  sends {', '.join(flows)}" if flows else ""
        moved = _moved(branch.robot)
        return f"{place}{branch.robot.name} {kind}{shown}{link}{_at(branch)}{moved}{sends}"
    if branch.slot and branch.slot.watched:
        return f"{place}watches {branch.slot.watched.name}"
    if branch.name:
        return f"{place}{branch.name} ({branch.state}){_at(branch)}"
    if branch.state:
        return f"{place}{branch.state}"
    wants = f"takes {branch.slot.kind}{', optional' if branch.slot.optional else ''}" if branch.slot else ""
    lost = branch.back or (branch.slot.lost if branch.slot else "")
    return f"{place}empty ({wants}{lost and '; '}{lost})"


def _moved(robot: RobotDescription) -> str:
    """Return the mark of one that people alone do not move: `  placement auto`."""
    if robot.placement == "manual":
        return ""
    better = f": better on {robot.advised}" if robot.advised else ""
    return f"  placement {robot.placement}{better}"


def _at(branch: Branch) -> str:
    return f"  [{branch.place.words}]" if branch.place else ""


def _lines(branch: Branch, lead: str, below: str) -> Iterable[str]:
    yield lead + label(branch)
    last = len(branch.branches) - 1
    for position, one in enumerate(branch.branches):
        elbow, bar = ("└─ ", "   ") if position == last else ("├─ ", "│  ")
        yield from _lines(one, below + elbow, below + bar)


def structure(branch: Branch) -> dict[str, object]:
    """Return a branch as plain data, for `--json`."""
    facts: dict[str, object] = {
        "name": branch.name,
        "kind": branch.robot.kind if branch.robot else "",
        "state": branch.state,
    }
    if branch.robot and (simulated := branch.robot.attributes.get("simulated")):
        facts["simulated"] = simulated == "yes"
    if branch.robot and branch.robot.link:
        facts["link"] = branch.robot.link
    if branch.place:
        facts |= {"site": branch.place.site, "age": branch.place.age}
    if branch.slot:
        facts |= {"slot": branch.slot.name, "takes": branch.slot.kind}
    return {**facts, "children": [structure(one) for one in branch.branches]}
