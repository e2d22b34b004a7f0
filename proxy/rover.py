"""The proxy of a rover: a base that drives in any direction without turning."""

from __future__ import annotations

import random
from typing import Annotated

import msgspec

from robotree.protocol.links.url import connect
from robotree.protocol.messages import LocalPositionNed
from robotree.proxy.connection import Dial
from robotree.proxy.guard import RoverLimits, check_arrival
from robotree.proxy.motion import Move
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.translate import readings_of
from robotree.vr.command import command
from robotree.vr.units import Range, Unit

LIMITS = RoverLimits()

Ahead = Annotated[float, Unit("m"), Range(LIMITS.x.lower, LIMITS.x.upper), "forward; negative: backward"]
Aside = Annotated[
    float, Unit("m"), Range(LIMITS.y.lower, LIMITS.y.upper), "to the left; negative: to the right"
]
Speed = Annotated[float, Unit("m/s"), Range(LIMITS.speed.lower, LIMITS.speed.upper), "along the way"]


class RoverInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Where a rover is and how it moves, along the axes of its floor."""

    x: Annotated[float, Unit("m"), "forward from the middle of the floor"]
    y: Annotated[float, Unit("m"), "to the left of it"]
    vx: Annotated[float, Unit("m/s"), "forward"]
    vy: Annotated[float, Unit("m/s"), "to the left"]


class Rover(RobotProxy):
    """A rover: it moves by a distance, forward and aside."""

    def __init__(
        self,
        name: str,
        url: str,
        limits: RoverLimits = LIMITS,
        *,
        dial: Dial = connect,
        chance: random.Random | None = None,
    ) -> None:
        """Prepare the proxy of one rover; see `RobotProxy`."""
        super().__init__(name, url, limits, dial=dial, chance=chance)
        self._arena = limits

    @command
    def move(self, x: Ahead, y: Aside, speed: Speed = 0.4) -> None:
        """Move by a distance from here, without turning."""
        here = self.get_info()
        motion = Move(x=x, y=y, speed=speed)
        check_arrival(motion, (here.x, here.y), self._arena, command=f"{self.name}.move")
        self.carry_out(motion)

    @command(effect="read")
    def get_info(self) -> RoverInfo:
        """Tell place and speed."""
        base = readings_of(self.news(LocalPositionNed, since=self.asked_at))
        return RoverInfo(x=base["x"], y=base["y"], vx=base["vx"], vy=base["vy"])
