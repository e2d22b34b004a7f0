"""The proxy of a rover: a base that drives in any direction without turning."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Annotated

import msgspec

from robotree.protocol.messages import LocalPositionNed, Verb
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Motion, PreviewedWay, Request
from robotree.proxy.robot_proxy import RobotProxy, Streamed
from robotree.proxy.translate import readings_of
from robotree.proxy.view import OFTEN, FloorPlace
from robotree.vr.author.command import command
from robotree.vr.author.stream import Stream
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.units import Unit

LIMITS: Limits = {
    "x": Span(-3.0, 3.0, "m"),
    "y": Span(-3.0, 3.0, "m"),
    "speed": Span(0.01, 1.0, "m/s"),
    "arena_x": Span(-1.5, 1.5, "m"),
    "arena_y": Span(-1.5, 1.5, "m"),
}
"""How far one move may lead, and how fast; and the arena around the origin of W that it may not leave."""
USUAL_SPEED = 0.4
"""[m/s] when the caller names none."""

Ahead = Annotated[float, Unit("m"), LIMITS["x"].range, "forward; negative: backward"]
Aside = Annotated[float, Unit("m"), LIMITS["y"].range, "to the left; negative: to the right"]
FloorX = Annotated[float, Unit("m"), LIMITS["arena_x"].range, "forward, from the middle of the floor"]
FloorY = Annotated[float, Unit("m"), LIMITS["arena_y"].range, "to the left of the middle"]
DriveSpeed = Annotated[float, Unit("m/s"), LIMITS["speed"].range, "along the way"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Move(Motion):
    """Move a mobile base by x, y [m] from where it stands, without turning, at speed [m/s]."""

    effect = "once"
    verb = Verb.MOVE

    x: float
    y: float
    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GoToPlace(Motion):
    """Drive straight to a place in W [m], without turning, at speed [m/s]; names are those of the limits."""

    effect = "repeat"

    arena_x: float
    arena_y: float
    speed: float

    def request(self) -> Request:
        """GO_TO; height and twist are those of the base."""
        return Request(Verb.GO_TO, (self.arena_x, self.arena_y, nan, nan, self.speed))


def check_arrival(motion: Move, here: tuple[float, float], limits: Limits, *, command: str) -> None:
    """Refuse a move that would end outside the arena.

    Args:
        motion: what is about to be sent.
        here: (2,) x, y [m] in W, where the base stands now.
        limits: those of this robot in this place.
        command: name of the command, for the sentence.

    Raises:
        BadArgument: it names the direction that leads out.
    """
    ends = {"x": here[0] + motion.x, "y": here[1] + motion.y}
    for name, end in ends.items():
        span = limits[f"arena_{name}"]
        if end not in span:
            reason = f"the move would end at {end:.3f} {span.unit}, the arena is {span}; send it another way"
            raise BadArgument(command=command, parameter=name, reason=reason)


class RoverInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Where a rover is and how it moves, along the axes of its floor."""

    x: Annotated[float, Unit("m"), "forward from the middle of the floor"]
    y: Annotated[float, Unit("m"), "to the left of it"]
    vx: Annotated[float, Unit("m/s"), "forward"]
    vy: Annotated[float, Unit("m/s"), "to the left"]


def _place(m: LocalPositionNed) -> FloorPlace:
    return FloorPlace(m.x, -m.y, 0.0)


class Rover(RobotProxy):
    """A rover: it moves by a distance, forward and aside."""

    limits = LIMITS
    place: Stream[FloorPlace] = Stream(FloorPlace, "where it stands", rate=OFTEN)
    streamed = (Streamed("place", LocalPositionNed, _place),)

    @command(offline="queue")
    def move(self, x: Ahead, y: Aside, speed: DriveSpeed = USUAL_SPEED) -> None:
        """Move by a distance from here, without turning."""
        motion = Move(x=x, y=y, speed=speed)

        def stay_inside() -> None:
            here = self.get_info()
            check_arrival(motion, (here.x, here.y), self.limits, command=f"{self.name}.move")

        self.carry_out(motion, before=stay_inside)

    @command(effect="repeat", offline="queue")
    def go_to(self, x: FloorX, y: FloorY, speed: DriveSpeed = USUAL_SPEED) -> None:
        """Drive straight to a place of the floor, without turning."""
        self.carry_out(self._to(x, y, speed))

    @command(effect="read")
    def preview_go_to(self, x: FloorX, y: FloorY, speed: DriveSpeed = USUAL_SPEED) -> PreviewedWay:
        """Tell the way that `go_to` would take, or why it would be refused; nothing moves."""
        return self.foresee(self._to(x, y, speed))

    def _to(self, x: float, y: float, speed: float) -> Motion:
        """Return the motion to a place."""
        return GoToPlace(arena_x=x, arena_y=y, speed=speed)

    @command(effect="read", offline="memory")
    def get_info(self) -> RoverInfo:
        """Tell place and speed."""
        base = readings_of(self.news(LocalPositionNed, since=self.asked_at))
        return RoverInfo(x=base["x"], y=base["y"], vx=base["vx"], vy=base["vy"])
