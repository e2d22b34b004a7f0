"""How a robot is, what matters most first: one ladder for command line, tree and full screen. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Literal, Protocol

Mood = Literal["free", "busy", "enslaved", "stopped", "offline", "abandoned", "silent"]

CALM: frozenset[Mood] = frozenset({"free", "enslaved"})
"""Moods that need no word beside a robot that is drawn in its place."""


class Condition(Protocol):
    """What a robot tells of itself: a state has it, and so has a description."""

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
        """Commands whose code heeds no cancel and still runs."""
        ...

    @property
    def bond(self) -> object | None:
        """Who commands it; None: nobody."""
        ...


def mood(robot: Condition) -> Mood:
    """Return how a robot says it is, in one word."""
    if not robot.online:
        return "offline"
    if robot.stopped:
        return "stopped"
    if robot.abandoned:
        return "abandoned"
    if robot.busy:
        return "busy"
    return "enslaved" if robot.bond is not None else "free"


def doing(robot: Condition, share: float | None = None) -> str:
    """Return how it is where the sign of its mood stands beside: `go_to 40% +2`.

    Args:
        robot: what it tells of itself.
        share: of the running command that is done, 0 to 1; None or not finite: it does not say.
    """
    match mood(robot):
        case "abandoned":
            return f"ABANDONED: {', '.join(robot.abandoned)} still runs"
        case "busy":
            done = f" {share:.0%}" if share is not None and isfinite(share) else ""
            return f"{robot.busy}{done}" + (f" +{robot.waiting}" if robot.waiting else "")
        case calm:
            return calm


def words(robot: Condition) -> str:
    """Return how it is where no sign stands beside: `busy: go_to +2`."""
    match mood(robot):
        case "busy":
            return f"busy: {doing(robot)}"
        case "stopped":
            return "STOPPED"
        case _:
            return doing(robot)
