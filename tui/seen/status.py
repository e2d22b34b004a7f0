"""How a robot is, what matters most first: one ladder for command line and full screen. Pure."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import Lack, RobotDescription
    from robotree.vr.base.requests import State

    Condition = State | RobotDescription
    """What a robot reports of itself."""

Status = Literal[
    "hangs",
    "gone",
    "late",
    "silent",
    "offline",
    "stopped",
    "abandoned",
    "moving",
    "paused",
    "busy",
    "waits",
    "needs",
    "away",
    "free",
    "enslaved",
]
"""The worst first. `hangs`, `gone`, `late` and `away` are found out by others; a robot does not say so."""

STATUSES: tuple[Status, ...] = get_args(Status)

CALM: frozenset[Status] = frozenset({"free", "enslaved"})
"""Statuses that need no word beside a robot that is drawn in its place."""

PROBLEMS: frozenset[Status] = frozenset(STATUSES[: STATUSES.index("abandoned") + 1])
"""Statuses of robots that somebody must look after."""

COUNTED: Mapping[Status, str] = {"hangs": "hang", "needs": "need others", "waits": "wait for their parent"}
"""A status as the verb of several robots, where that is another word."""

LONG = 120.0
"""[s] from which on a time is written in minutes."""

CONDITION = "condition"
"""Attribute in which a robot says itself how it is."""

UNGUARDED = "open link"
"""Beside a robot whose controller obeys every program that reaches it."""


def status_of(robot: Condition, lacks: Sequence[Lack] = ()) -> Status:
    """Return how a robot is, in one word: what it says of itself, and what it lacks (`lacks_of`)."""
    ladder: tuple[tuple[Status, object], ...] = (
        ("offline", not robot.online),
        ("stopped", robot.stopped),
        ("abandoned", robot.abandoned),
        ("moving", robot.on_way),
        ("paused", robot.paused),
        ("busy", robot.busy),
        ("waits", robot.away is not None),
        ("needs", lacks),
        ("enslaved", robot.bond is not None),
    )
    for status, holds in ladder:
        if holds:
            return status
    return "free"


Described = Callable[[str], "RobotDescription | None"]
"""Returns how a robot of this name describes itself; None: it is not known."""


def lacks_of(
    robot: RobotDescription,
    described: Described = lambda _: None,
    hanging: Collection[str] = (),
    above: tuple[str, ...] = (),
) -> list[Lack]:
    """Return the children that a robot must have before all its commands can be used.

    Args:
        robot: with slots.
        described: of the robots below it, whose slots count, too: `mover.arm`, as `enslave` wants it.
        hanging: names of robots that hang: only of these `Lack.was` says that one is missing.
        above: the robots on the way down to this one; the first one's slots have no name before them.
    """
    if not robot.slots:
        return []
    from robotree.vr.base.description import lacking  # help must not wait for the agents

    lead, path = f"{robot.name}." if above else "", (*above, robot.name)
    found = [
        lack._replace(slot=f"{lead}{lack.slot}", was=lack.was if lack.was in hanging else "")
        for lack in lacking(robot.slots)
    ]
    for slot in robot.slots:
        if slot.child and slot.child.name not in path and (child := described(slot.child.name)):
            found += lacks_of(child, described, hanging, path)
    return found


def needs(lacks: Sequence[Lack]) -> str:
    """Write which children hang, and what must be enslaved: `arm: arm-1 hangs; needs rovers: Rover x 2`."""
    empty = ", ".join(
        f"{lack.slot}: {lack.kind}" + (f" x {lack.number}" if lack.number > 1 else "")
        for lack in lacks
        if not lack.was
    )
    hang = (f"{lack.slot}: {lack.was} hangs" for lack in lacks if lack.was)
    return "; ".join([*hang, *([f"needs {empty}"] if empty else [])])


def way(robot: Condition) -> str:
    """Write where a robot is on its way: `on its way h1 → h2`."""
    host: str = getattr(robot, "host", "")
    told = f"on its way {host} → {robot.on_way}" if host else f"on its way to {robot.on_way}"
    return f"{told}, in doubt: nobody acts for it until {robot.on_way} answers" if robot.in_doubt else told


def span(seconds: float) -> str:
    """Write how long something takes or how old it is: `12 s`, `3 min`, `2 h`."""
    if seconds < LONG:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < LONG else f"{minutes / 60:.0f} h"


def doing(
    robot: Condition,
    share: float | None = None,
    *,
    lacks: Sequence[Lack] = (),
    seconds: float = 0.0,
    note: str = "",
) -> str:
    """Return how it is beside the sign of its status: `go_to 40 % 12 s +2; better off on host-2`.

    Args:
        robot: what it reports of itself.
        share: of the running command that is done, 0 to 1; None or not finite: it does not say.
        lacks: what must be enslaved before all its commands can be used.
        seconds: for which the command has been running, as far as that was seen.
        note: what the command says itself of how far it is.
    """
    match status_of(robot, lacks):
        case "abandoned":
            text = f"ABANDONED: {', '.join(robot.abandoned)} still runs"
        case "moving":
            return way(robot)
        case "paused":
            text = f"paused before {robot.held}" if robot.held else f"paused: {robot.busy or 'idle'}"
        case "busy":
            parts = [
                robot.busy,
                f"{share:.0%}".replace("%", " %") if share is not None and isfinite(share) else "",
                span(seconds) if seconds >= 1.0 else "",
                f"+{robot.waiting}" if robot.waiting else "",
                note,
            ]
            text = " ".join(filter(None, parts))
        case "waits":
            text = f"its parent is away, {robot.away or 0.0:.0f} s left"
        case "needs":
            text = needs(lacks)
        case calm:
            text = calm
    return f"{text}; better off on {robot.advised}" if robot.advised and not robot.on_way else text


def text(
    robot: RobotDescription, described: Described = lambda _: None, hanging: Collection[str] = ()
) -> str:
    """Return how a robot is; a script has a condition of its own: `inactive: needs robot (Arm)`.

    Args:
        robot: which.
        described: of the robots below it (`lacks_of`).
        hanging: names of robots that hang.
    """
    if robot.asks:
        return f"ASKS (decide {robot.name})"
    condition, lacks = robot.attributes.get(CONDITION, ""), lacks_of(robot, described, hanging)
    if not condition or robot.stopped or robot.abandoned:
        return words(robot, lacks)
    return condition if condition != "ready" else words(robot, lacks)


def words(robot: Condition, lacks: Sequence[Lack] = ()) -> str:
    """Return how it is where no sign stands beside: `busy: go_to +2`."""
    match status_of(robot, lacks):
        case "busy":
            return f"busy: {doing(robot)}"
        case "stopped":
            return "STOPPED"
        case _:
            return doing(robot, lacks=lacks)
