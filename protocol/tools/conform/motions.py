"""The motions of each kind of robot while its controller is examined: a slow movement, and back. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec

from robotree.protocol.messages import BaseState, Joints, LocalPositionNed, Message, Tool, Verb
from robotree.protocol.services.goal_client import padded

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

Place = tuple[float, ...]
NAN = math.nan


class Motions(msgspec.Struct, frozen=True, kw_only=True):
    """A movement between two places that one kind of robot can do, with all numbers in SI units."""

    kind: str
    """As the proxies name it."""
    telemetry: type[Message]
    """The message that tells the place."""
    place: Callable[[Any], Place]
    """Read the place from it."""
    goal: Callable[[Place, Place, float], tuple[int, Place]]
    """The verb and the arguments that lead from one place to another, at a speed."""
    offset: Place
    """From the place at the start to the other end of the movement."""
    slow: float
    """[m/s] or [rad/s] of a movement that no rule waits for; less if the way is too short for it."""
    slowest: float
    """[m/s] or [rad/s] The proxies ask for no less."""
    quick: float
    """[m/s] or [rad/s]"""
    still: float
    """[m] or [rad] by which a robot that stands may move in half a second."""
    lever: float = 1.0
    """Length in units of the speed per unit of the place: [m/rad] where a hand's speed leads to an angle."""
    summary: str
    """Where it will move, for people."""


def _by(here: Place, there: Place, speed: float) -> tuple[int, Place]:
    return Verb.MOVE, padded((there[0] - here[0], there[1] - here[1], speed))


def _to(_: Place, there: Place, speed: float) -> tuple[int, Place]:
    return Verb.GO_TO, padded((*there, NAN, speed))


def _posture(_: Place, there: Place, speed: float) -> tuple[int, Place]:
    return Verb.POSTURE, (*there, speed)


def _look(_: Place, there: Place, speed: float) -> tuple[int, Place]:
    return Verb.LOOK, padded((*there, speed))


ROVER = Motions(
    kind="rover",
    telemetry=LocalPositionNed,
    place=lambda message: (message.x, -message.y),
    goal=_by,
    offset=(0.4, 0.0),
    slow=0.03,
    slowest=0.01,
    quick=0.5,
    still=0.003,
    summary="up to 0.4 m forward and back",
)
KINDS = {
    each.kind: each
    for each in (
        Motions(
            kind="arm",
            telemetry=Tool,
            place=lambda message: (message.x, message.y, message.z),
            goal=_to,
            offset=(0.0, 0.0, -0.12),
            slow=0.02,
            slowest=0.005,
            quick=0.2,
            still=0.004,
            summary="the gripper up to 0.12 m down and back",
        ),
        ROVER,
        msgspec.structs.replace(ROVER, kind="base", slow=0.04),
        Motions(
            kind="limb",
            telemetry=Joints,
            place=lambda message: message.position[:6],
            goal=_posture,
            offset=(0.5, 0.0, 0.0, 0.0, 0.0, 0.0),
            slow=0.05,
            slowest=0.01,
            quick=0.5,
            still=0.01,
            lever=0.25,
            summary="the first joint up to 0.5 rad and back",
        ),
        Motions(
            kind="head",
            telemetry=Joints,
            place=lambda message: message.position[:2],
            goal=_look,
            offset=(0.6, 0.0),
            slow=0.06,
            slowest=0.05,
            quick=1.0,
            still=0.006,
            summary="to the left by 0.6 rad and back",
        ),
    )
}
"""The movements, by the kinds of the proxies."""


def recognised(kinds: Collection[type[object]], component: int) -> Motions | None:
    """The movements of a controller that sends these kinds of telemetry; None: of no kind that is known."""
    if BaseState in kinds:
        return KINDS["base"]
    if LocalPositionNed in kinds:
        return KINDS["rover"]
    if Tool in kinds:
        return KINDS["arm" if component == 1 else "limb"]
    return KINDS["head"] if Joints in kinds else None
