"""How a robot is, what matters most first: one ladder for command line and full screen. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Literal, Protocol, get_args

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.description import RobotDescription, SlotSpec

Status = Literal[
    "hangs", "gone", "silent", "offline", "stopped", "abandoned", "busy", "needs", "free", "enslaved"
]
"""The worst first. `hangs` and `gone` are found out by others; a robot does not say so itself."""

STATUSES: tuple[Status, ...] = get_args(Status)

CALM: frozenset[Status] = frozenset({"free", "enslaved"})
"""Statuses that need no word beside a robot that is drawn in its place."""

SHORT = 10.0
"""[s] below which tenths of a second count."""
LONG = 120.0
"""[s] from which on a time is written in minutes."""

CONDITION = "condition"
"""Attribute in which a robot says itself how it is."""

UNGUARDED = "open link"
"""Beside a robot whose controller obeys every program that reaches it."""


class Condition(Protocol):
    """What a robot reports of itself, in its state and in its description."""

    @property
    def busy(self) -> str:
        """The command that runs; empty: none."""
        ...

    @property
    def waiting(self) -> int:
        """How many commands wait behind it."""
        ...

    @property
    def online(self) -> bool:
        """Whether its controller can be reached."""
        ...

    @property
    def stopped(self) -> bool:
        """Whether it is in protective stop."""
        ...

    @property
    def abandoned(self) -> Sequence[str]:
        """Commands that were cancelled and whose code still runs."""
        ...

    @property
    def bond(self) -> object | None:
        """Who commands it; None: nobody."""
        ...


def status_of(robot: Condition, slots: Iterable[SlotSpec] = ()) -> Status:
    """Return how a robot says it is, in one word; one of its slots may be empty."""
    if not robot.online:
        return "offline"
    if robot.stopped:
        return "stopped"
    if robot.abandoned:
        return "abandoned"
    if robot.busy:
        return "busy"
    if needs(slots):
        return "needs"
    return "enslaved" if robot.bond is not None else "free"


def needs(slots: Iterable[SlotSpec]) -> str:
    """Return what must be enslaved before all commands can be used: `arm: Arm`; empty: nothing."""
    slots = tuple(slots)
    if not slots:
        return ""
    from robotree.vr.description import lacking  # help must not wait for the agents

    return ", ".join(
        f"{lack.slot}: {lack.kind}" + (f" x {lack.number}" if lack.number > 1 else "")
        for lack in lacking(slots)
    )


def span(seconds: float) -> str:
    """Write how long something takes or how old it is: `12 s`, `3 min`, `2 h`."""
    if seconds < LONG:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < LONG else f"{minutes / 60:.0f} h"


def took(seconds: float) -> str:
    """Write how long something took: `0.3 s`, `12 s`, `3 min`."""
    return f"{seconds:.1f} s" if seconds < SHORT else span(seconds)


def doing(
    robot: Condition,
    share: float | None = None,
    *,
    slots: Iterable[SlotSpec] = (),
    seconds: float = 0.0,
    note: str = "",
) -> str:
    """Return how it is where the sign of its status stands beside: `go_to 40 % 12 s +2`.

    Args:
        robot: what it reports of itself.
        share: of the running command that is done, 0 to 1; None or not finite: it does not say.
        slots: of a virtual robot: an empty one is what it needs.
        seconds: for which the command has been running, as far as that was seen.
        note: what the command says itself of how far it is.
    """
    slots = tuple(slots)
    match status_of(robot, slots):
        case "abandoned":
            return f"ABANDONED: {', '.join(robot.abandoned)} still runs"
        case "busy":
            parts = [
                robot.busy,
                f"{share:.0%}".replace("%", " %") if share is not None and isfinite(share) else "",
                span(seconds) if seconds >= 1.0 else "",
                f"+{robot.waiting}" if robot.waiting else "",
                note,
            ]
            return " ".join(filter(None, parts))
        case "needs":
            return f"needs {needs(slots)}"
        case calm:
            return calm


def text(robot: RobotDescription) -> str:
    """Return how a robot is; a script has a condition of its own: `inactive: needs robot (Arm)`."""
    condition = robot.attributes.get(CONDITION, "")
    if not condition or not robot.online or robot.stopped or robot.abandoned:
        return words(robot, robot.slots)
    return condition if condition != "ready" else words(robot, robot.slots)


def words(robot: Condition, slots: Iterable[SlotSpec] = ()) -> str:
    """Return how it is where no sign stands beside: `busy: go_to +2`."""
    slots = tuple(slots)
    match status_of(robot, slots):
        case "busy":
            return f"busy: {doing(robot)}"
        case "stopped":
            return "STOPPED"
        case _:
            return doing(robot, slots=slots)
