"""The proxy of a companion's base: a rover that turns, finds its way around things, and leans."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from robotree.protocol.messages import BaseState, LocalPositionNed, SysStatus, Verb
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Motion, PreviewedWay
from robotree.proxy.robot_proxy import Streamed
from robotree.proxy.rover import LIMITS as ROVER_LIMITS
from robotree.proxy.rover import Rover, RoverInfo
from robotree.proxy.translate import READERS, UNITS, MessageReaders
from robotree.proxy.view import FloorPlace
from robotree.vr.author.command import command
from robotree.vr.base.units import Unit

LIMITS: Limits = {
    **ROVER_LIMITS,
    "x": Span(-6.0, 6.0, "m"),
    "y": Span(-6.0, 6.0, "m"),
    "arena_x": Span(-3.0, 3.0, "m"),
    "arena_y": Span(-2.4, 2.4, "m"),
    "speed": Span(0.01, 0.8, "m/s"),
    "heading": Span(-2 * math.pi, 2 * math.pi, "rad"),
    "angle": Span(-0.1, 0.7, "rad"),
}
"""How far one way may lead, the flat's floor, how fast, and how far the waist leans."""
USUAL_SPEED = 0.4
"""[m/s] when the caller names none."""

X = Annotated[float, Unit("m"), LIMITS["x"].range, "of the flat, forward from its middle"]
Y = Annotated[float, Unit("m"), LIMITS["y"].range, "of the flat, to the left of its middle"]
Heading = Annotated[float, Unit("rad"), LIMITS["heading"].range, "counterclockwise from x of the flat"]
BaseSpeed = Annotated[float, Unit("m/s"), LIMITS["speed"].range, "along the way; slower near people"]
Angle = Annotated[float, Unit("rad"), LIMITS["angle"].range, "forward"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive(Motion):
    """Drive to x, y [m] of the flat and turn to heading [rad], at speed [m/s]."""

    effect = "repeat"
    verb = Verb.DRIVE

    x: float
    y: float
    heading: float
    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn(Motion):
    """Turn on the spot to heading [rad] in the flat."""

    effect = "repeat"
    verb = Verb.TURN

    heading: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Lean(Motion):
    """Lean the waist by angle [rad]."""

    effect = "repeat"
    verb = Verb.LEAN

    angle: float


class BaseInfo(RoverInfo, frozen=True, kw_only=True):
    """Where a base is, how it moves, how it leans, and how full its battery is."""

    heading: Heading
    lean: Annotated[float, Unit("rad"), "of the waist, forward"]
    balance: Annotated[float, Unit("m"), "by which the weight stays inside the wheels when it brakes"]
    nearest: Annotated[float, Unit("m"), "to the nearest person"]
    battery: Annotated[float, "how full, 0 to 1"]
    charging: bool


def _base(m: BaseState) -> dict[str, float]:
    return {"heading": m.heading, "lean": m.lean, "balance": m.balance, "nearest_person": m.nearest}


def _place(m: BaseState) -> FloorPlace:
    return FloorPlace(m.x, m.y, math.remainder(m.heading, math.tau))


def _status(m: SysStatus) -> dict[str, float]:
    return {"battery": m.battery_remaining / 100.0} if m.battery_remaining >= 0 else {}


BASE_READERS: MessageReaders = {**READERS, BaseState: _base, SysStatus: _status}
"""How the telemetry of a base reads."""
BASE_UNITS: Mapping[str, str] = {
    **UNITS,
    **dict.fromkeys(("heading", "lean"), "rad"),
    **dict.fromkeys(("balance", "nearest_person"), "m"),
}


class Base(Rover):
    """The base of a companion: it drives around what is in the way, turns, leans its waist, and charges."""

    limits = LIMITS
    readers = BASE_READERS
    reading_units = BASE_UNITS
    streamed = (Streamed("place", BaseState, _place),)

    @command(effect="repeat", offline="queue")
    def drive(self, x: X, y: Y, heading: Heading, speed: BaseSpeed = USUAL_SPEED) -> None:
        """Drive to a place, around what stands in the way, and turn."""
        self.carry_out(Drive(x=x, y=y, heading=heading, speed=speed))

    @command(effect="read")
    def preview_drive(self, x: X, y: Y, heading: Heading, speed: BaseSpeed = USUAL_SPEED) -> PreviewedWay:
        """Tell the way that `drive` would take, or why it would be refused; nothing moves."""
        return self.foresee(Drive(x=x, y=y, heading=heading, speed=speed))

    @command(effect="repeat", offline="queue")
    def go_to(self, x: X, y: Y, speed: BaseSpeed = USUAL_SPEED) -> None:
        """Drive to a place, around what stands in the way, with the heading that it has now."""
        self.carry_out(self._to(x, y, speed))

    @command(effect="read")
    def preview_go_to(self, x: X, y: Y, speed: BaseSpeed = USUAL_SPEED) -> PreviewedWay:
        """Tell the way that `go_to` would take, or why it would be refused; nothing moves."""
        return self.foresee(self._to(x, y, speed))

    def _to(self, x: float, y: float, speed: float) -> Motion:
        heading = math.remainder(self.news(BaseState, since=self.asked_at).heading, math.tau)
        return Drive(x=x, y=y, heading=heading, speed=speed)

    @command(effect="repeat", offline="queue")
    def turn(self, heading: Heading) -> None:
        """Turn on the spot."""
        self.carry_out(Turn(heading=heading))

    @command(effect="repeat")
    def lean(self, angle: Angle) -> None:
        """Lean the waist forward."""
        self.carry_out(Lean(angle=angle))

    @command(effect="read", offline="memory")
    def get_info(self) -> BaseInfo:
        """Tell place, speed, lean, balance and battery."""
        asked = self.asked_at
        state, place = self.news(BaseState, since=asked), self.news(LocalPositionNed, since=asked)
        status = self._session.twin.latest(SysStatus)
        return BaseInfo(
            x=state.x,
            y=state.y,
            vx=place.vx,
            vy=-place.vy,
            heading=math.remainder(state.heading, math.tau),
            lean=state.lean,
            balance=state.balance,
            nearest=state.nearest,
            battery=max(status.battery_remaining, 0) / 100.0 if status is not None else 0.0,
            charging=bool(state.charging),
        )
