"""Motions: what a proxy can ask of a controller, in the terms and units of the agents' side.

A motion has no key, no epoch and no time. `guard` checks its numbers; `request` says how the wire encodes it.
The motions of a kind of robot are in the module of that kind. Here is what they have in common, and the one
that every controller knows.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import ClassVar, NamedTuple

from robotree.protocol.messages import Verb
from robotree.vr.base.description import Effect


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Motion):
    """Stay, compliantly, and drop any other goal."""

    effect = "repeat"
    verb = Verb.HOLD
