"""The proxy of one arm of a companion: an arm whose hand may point anywhere, before a body that moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from robotree.protocol.messages import Verb
from robotree.proxy.arm import LIMITS as ARM_LIMITS
from robotree.proxy.arm import Arm, GoTo, Twist
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Motion, PreviewedWay, Request
from robotree.vr.author.command import command
from robotree.vr.base.units import Unit

LIMITS: Limits = {
    **ARM_LIMITS,
    "x": Span(-0.5, 0.9, "m"),
    "y": Span(-0.95, 0.95, "m"),
    "z": Span(0.15, 1.8, "m"),
    "speed": Span(0.01, 0.8, "m/s"),
    "hand": Span(0, 3, ""),
    "j1": Span(-0.9, 2.9, "rad"),
    "j2": Span(-0.7, 2.6, "rad"),
    "j3": Span(-1.6, 1.6, "rad"),
    "j4": Span(0.1, 2.5, "rad"),
    "j5": Span(-2.9, 2.9, "rad"),
    "j6": Span(-1.9, 1.9, "rad"),
}
"""Where the hand may be sent, in the body's frame, and how far the joints go. Faster than 0.25 m/s only with
nobody beside the hand; that, and what is within reach, the controller knows."""
USUAL_SPEED = 0.25
"""[m/s] when the caller names none."""
POINTING: dict[str, tuple[float, float]] = {
    "any": (math.nan, math.nan),
    "level": (math.nan, math.pi / 2),
    "forward": (0.0, math.pi / 2),
    "down": (math.nan, 0.0),
}
"""Twist and tilt of the hand [rad]; NaN: any that suits."""

X = Annotated[float, Unit("m"), LIMITS["x"].range, "forward, from the middle of the base"]
Y = Annotated[float, Unit("m"), LIMITS["y"].range, "to the left"]
Z = Annotated[float, Unit("m"), LIMITS["z"].range, "up, from the floor"]
HandSpeed = Annotated[float, Unit("m/s"), LIMITS["speed"].range, "of the hand"]
HandBlend = Annotated[
    float, Unit("m"), LIMITS["blend"].range, "without effect: this hand stands at every point"
]
J1 = Annotated[float, Unit("rad"), LIMITS["j1"].range, "upper arm forward"]
J2 = Annotated[float, Unit("rad"), LIMITS["j2"].range, "upper arm outward"]
J3 = Annotated[float, Unit("rad"), LIMITS["j3"].range, "upper arm about itself, outward"]
J4 = Annotated[float, Unit("rad"), LIMITS["j4"].range, "elbow; 0 is stretched"]
J5 = Annotated[float, Unit("rad"), LIMITS["j5"].range, "forearm about itself, outward"]
J6 = Annotated[float, Unit("rad"), LIMITS["j6"].range, "wrist forward"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach(Motion):
    """Bring the hand to x, y, z [m] at speed [m/s], the fingers as the entry `hand` of `POINTING` says."""

    effect = "repeat"

    x: float
    y: float
    z: float
    speed: float
    hand: int

    def request(self) -> Request:
        """REACH."""
        twist_and_tilt = [*POINTING.values()][self.hand]
        return Request(Verb.REACH, (self.x, self.y, self.z, *twist_and_tilt, self.speed))


@dataclass(frozen=True, slots=True, kw_only=True)
class Posture(Motion):
    """Bring the joints to angles [rad]; the hand moves at speed [m/s] at most."""

    effect = "repeat"
    verb = Verb.POSTURE

    j1: float
    j2: float
    j3: float
    j4: float
    j5: float
    j6: float
    speed: float


class Limb(Arm):
    """An arm of a body: goes to points before the body, takes postures, yields when pushed, and feels."""

    limits = LIMITS
    frame = "/body"
    camera = None
    pictures = None  # type: ignore[assignment] # its wrist has none

    @command(effect="repeat", offline="queue")
    def go_to(
        self, x: X, y: Y, z: Z, twist: Twist, speed: HandSpeed = USUAL_SPEED, blend: HandBlend = 0.0
    ) -> None:
        """Move the hand to a point, the fingers down, and turn it."""
        self.carry_out(GoTo(x=x, y=y, z=z, twist=twist, speed=speed, blend=blend))

    @command(effect="read")
    def preview_go_to(self, x: X, y: Y, z: Z, twist: Twist, speed: HandSpeed = USUAL_SPEED) -> PreviewedWay:
        """Tell the way that `go_to` would take, or why it would be refused; nothing moves."""
        return self.foresee(GoTo(x=x, y=y, z=z, twist=twist, speed=speed))

    @command(effect="repeat", offline="queue")
    def reach(
        self,
        x: X,
        y: Y,
        z: Z,
        hand: Literal["any", "level", "forward", "down"] = "any",
        speed: HandSpeed = USUAL_SPEED,
    ) -> None:
        """Move the hand to a point before the body, around what is in the way."""
        self.carry_out(Reach(x=x, y=y, z=z, speed=speed, hand=[*POINTING].index(hand)))

    @command(effect="repeat", offline="queue")
    def posture(self, j1: J1, j2: J2, j3: J3, j4: J4, j5: J5, j6: J6, speed: HandSpeed = USUAL_SPEED) -> None:
        """Bring the six joints to angles; the same angles look the same, mirrored, on both arms."""
        self.carry_out(Posture(j1=j1, j2=j2, j3=j3, j4=j4, j5=j5, j6=j6, speed=speed))
