"""Motions: what a proxy can ask of a controller, in the terms and units of the agents' side.

A motion has no key, no epoch and no time. `guard` checks its numbers; `request` says how the wire encodes it.
The motions of a kind of robot are in the module of that kind. Here is what they have in common, and the one
that every controller knows.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from itertools import takewhile
from typing import Annotated, ClassVar, NamedTuple

import msgspec

from robotree.protocol.messages import Verb, WayStatus
from robotree.vr.base.description import Effect
from robotree.vr.base.units import Unit


class Request(NamedTuple):
    """The content of a goal, as the wire encodes it."""

    verb: int
    """One of `Verb`, or a number from 0x8000 on that a controller and its proxy have agreed upon."""
    args: tuple[float, ...]
    """Up to seven, in the order and units of the dialect; what is left out, and NaN, is as it is now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """One motion. Its fields are numbers, and each has a limit of the same name."""

    effect: ClassVar[Effect] = "once"
    """The effect of a second execution: `once` adds up, `repeat` ends the same. After a restart of
    the controller only the second is asked for again."""
    verb: ClassVar[int]
    """Number of the verb that it is on the wire."""

    def request(self) -> Request:
        """Encode it for the wire: its verb with its fields, in their order. Pure.

        A motion whose arguments on the wire are others than its fields has a `request` of its own.
        """
        return Request(self.verb, tuple(float(value) for value in astuple(self)))


Metres = list[Annotated[float, Unit("m")]]


class PreviewedWay(msgspec.Struct, frozen=True, kw_only=True):
    """The way that a motion would take, point by point in the frame of its coordinates.

    The first point is where the tool or base is now; the lists have equal lengths, and are empty where the
    controller tells no way.
    """

    x: Metres
    y: Metres
    z: Metres
    duration: Annotated[float, Unit("s"), "when nothing holds it up; 0: not known"]
    checked: Annotated[bool, "whether the controller was asked: else only the limits were compared"]
    refusal: Annotated[str, "why it would be refused now; empty: it would not"] = ""


def refused_way(why: str) -> PreviewedWay:
    """Return the preview of a motion that would be refused. Pure."""
    return PreviewedWay(x=[], y=[], z=[], duration=0.0, checked=True, refusal=why)


def way_of(told: WayStatus) -> PreviewedWay:
    """Return the way that a controller tells. Pure; what is not finite ends it."""
    points = [*zip(told.x, told.y, told.z, strict=True)][: told.count]
    points = [*takewhile(lambda point: all(map(math.isfinite, point)), points)]
    x, y, z = ([point[axis] for point in points] for axis in range(3))
    duration = told.duration if math.isfinite(told.duration) else 0.0
    return PreviewedWay(x=x, y=y, z=z, duration=duration, checked=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Motion):
    """Stay, compliantly, and drop any other goal."""

    effect = "repeat"
    verb = Verb.HOLD
