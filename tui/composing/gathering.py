"""What was shown, out of what robots remember: their histories and states. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from math import inf
from typing import Any, Final, NamedTuple, cast

import msgspec

from robotree.tui.composing.demonstration import AXES, GRIP, Pose, Shown, ShownRobot
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.principal import is_person

EMPTY: Final = 0.001
"""[m] between closed fingers up to which nothing is there: so near is at a width (`sim.arm.gripper`)."""


class Felt(NamedTuple):
    """What a robot has read at a time while something was shown."""

    robot: str
    unix: float
    """[s] since 1970."""
    readings: Mapping[str, Any]
    """In SI units; of them `holding` counts, else `width`."""
    age: float = 0.0
    """[s] that they may be old at that time."""


class Gathered(msgspec.Struct, frozen=True):
    """What was shown, by which robots, from where on."""

    robots: tuple[ShownRobot, ...]
    shown: tuple[Shown, ...]
    starts: Mapping[str, Pose]
    failed: int = 0
    """Commands that did not end well, and are left out."""


def gathered(
    events: Iterable[HistoryEvent],
    described: Mapping[str, RobotDescription],
    wanted: Collection[str] = (),
    starts: Mapping[str, Mapping[str, float]] | None = None,
    felt: Iterable[Felt] = (),
) -> Gathered:
    """Return the commands that ended well, in the order in which they were asked.

    Args:
        events: of the histories of the robots.
        described: the robots, by name.
        wanted: what these robots did, whoever asked; empty: what persons asked of any robot.
        starts: the readings of each robot before it began.
        felt: what the robots read meanwhile: whether something was between the fingers.
    """
    begun: list[HistoryEvent] = []
    ended: dict[tuple[str, str], HistoryEvent] = {}
    for event in sorted(events, key=lambda each: each.unix):
        asked = event.robot in wanted if wanted else is_person(event.person or event.caller)
        if event.kind == "accepted" and asked and event.robot in described:
            begun.append(event)
        elif event.kind == "ended":
            ended[event.robot, event.key] = event
    shown: list[Shown] = []
    seen: set[tuple[str, str]] = set()
    newest_first = sorted(felt, key=lambda each: -each.unix)
    for index, event in enumerate(begun):
        key = (event.robot, event.key)
        end = ended.get(key)
        one = _shown(event, described[event.robot])
        if one is not None and end is not None and not end.error and key not in seen:
            if one.command == GRIP:
                grips = (e.unix for e in begun[index + 1 :] if (e.robot, e.command) == (event.robot, GRIP))
                until = min(grips, default=inf)
                one = one._replace(holding=_held(newest_first, event.robot, end.unix, until))
            shown.append(one)
        seen.add(key)
    names = dict.fromkeys(one.robot for one in shown)
    poses = {name: pose for name in names if (pose := _pose((starts or {}).get(name, {}))) is not None}
    robots = tuple(shown_robot(described[name]) for name in names)
    return Gathered(robots, tuple(shown), poses, len(seen) - len(shown))


def shown_robot(described: RobotDescription) -> ShownRobot:
    """Return a robot with which something was shown."""
    return ShownRobot(described.name, described.kind, {one.name: one for one in described.commands})


def _shown(event: HistoryEvent, robot: RobotDescription) -> Shown | None:
    """Return one command with its arguments as the robot takes them; None: it does not take them."""
    spec = robot.command(event.command)
    came: Any = event.arguments
    given: dict[str, Any] = cast("dict[str, Any]", came) if isinstance(came, dict) else {}
    if spec is None:
        return None
    try:
        arguments = check_arguments(spec, given)
    except BadArgument:
        return None
    return Shown(event.robot, event.command, arguments)


def _held(newest_first: Iterable[Felt], robot: str, since: float, until: float) -> bool | None:
    """Return whether something was between closed fingers in a time; None: nothing was read that says so."""
    for one in newest_first:
        if one.robot == robot and since <= one.unix - one.age and one.unix < until:
            if isinstance(holding := one.readings.get("holding"), bool):
                return holding
            if isinstance(width := one.readings.get("width"), int | float):
                return width > EMPTY
    return None


def _pose(readings: Mapping[str, float]) -> Pose | None:
    if not set(AXES) <= readings.keys():
        return None
    x, y, z, twist = (readings[axis] for axis in AXES)
    return x, y, z, twist
