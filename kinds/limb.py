"""The interface of Limb. Written by `python docs/kinds.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from robotree.vr import Kind, Range, Unit, Within, promised


@dataclass(kw_only=True)
class LimbInfo:
    """Values by name."""

    x: Annotated[float, Unit("m"), Range(-0.65, 0.65), "forward, from the foot of the arm"]
    y: Annotated[float, Unit("m"), Range(-0.65, 0.65), "to the left"]
    z: Annotated[float, Unit("m"), Range(0.025, 0.8), "up, from the table"]
    twist: Annotated[
        float,
        Unit("rad"),
        Range(-3.141592653589793, 3.141592653589793),
        "of the gripper, counterclockwise from above",
    ]
    fx: Annotated[float, Unit("N"), "of the world on the tool"]
    fy: Annotated[float, Unit("N"), "of the world on the tool"]
    fz: Annotated[float, Unit("N"), "of the world on the tool"]
    tx: Annotated[float, Unit("N*m"), "of the world on the tool"]
    ty: Annotated[float, Unit("N*m"), "of the world on the tool"]
    tz: Annotated[float, Unit("N*m"), "of the world on the tool"]
    width: Annotated[float, Unit("m"), Range(0.0, 0.08), "between the fingers"]
    holding: Annotated[bool, "whether something is between the fingers"]
    busy: Annotated[bool, "whether it moves to a goal"]


class Limb(Kind):
    """An arm of a body: goes to points before the body, takes postures, yields when pushed, and feels."""

    @promised(effect="read")
    def halt(self, *, within: Within = None) -> None:
        """Stop moving and stay here, compliantly; the next command may move again."""
        raise NotImplementedError

    @promised(effect="repeat")
    def go_to(
        self,
        x: Annotated[float, Unit("m"), Range(-0.5, 0.9), "forward, from the middle of the base"],
        y: Annotated[float, Unit("m"), Range(-0.95, 0.95), "to the left"],
        z: Annotated[float, Unit("m"), Range(0.15, 1.8), "up, from the floor"],
        twist: Annotated[
            float,
            Unit("rad"),
            Range(-3.141592653589793, 3.141592653589793),
            "of the gripper, counterclockwise from above",
        ],
        speed: Annotated[float, Unit("m/s"), Range(0.01, 0.8), "of the hand"] = 0.25,
        blend: Annotated[
            float, Unit("m"), Range(0.0, 0.05), "without effect: this hand stands at every point"
        ] = 0.0,
        *,
        within: Within = None,
    ) -> None:
        """Move the hand to a point, the fingers down, and turn it."""
        raise NotImplementedError

    @promised(effect="read")
    def get_info(self, *, within: Within = None) -> LimbInfo:
        """Tell place, twist, forces on every axis, and what the gripper does."""
        raise NotImplementedError

    @promised(effect="repeat")
    def grip(
        self,
        action: Literal["open", "close", "width"],
        width: Annotated[float, Unit("m"), Range(0.0, 0.08), "between the fingers"] = 0.08,
        *,
        within: Within = None,
    ) -> None:
        """Open or close the gripper, or bring it to a width; it stops at what is between the fingers."""
        raise NotImplementedError

    @promised(effect="repeat")
    def hold(self, *, within: Within = None) -> None:
        """Stay here: yield when pushed, and come back."""
        raise NotImplementedError

    @promised(effect="repeat")
    def reach(
        self,
        x: Annotated[float, Unit("m"), Range(-0.5, 0.9), "forward, from the middle of the base"],
        y: Annotated[float, Unit("m"), Range(-0.95, 0.95), "to the left"],
        z: Annotated[float, Unit("m"), Range(0.15, 1.8), "up, from the floor"],
        hand: Literal["any", "level", "forward", "down"] = "any",
        speed: Annotated[float, Unit("m/s"), Range(0.01, 0.8), "of the hand"] = 0.25,
        *,
        within: Within = None,
    ) -> None:
        """Move the hand to a point before the body, around what is in the way."""
        raise NotImplementedError

    @promised(effect="repeat")
    def posture(
        self,
        j1: Annotated[float, Unit("rad"), Range(-0.9, 2.9), "upper arm forward"],
        j2: Annotated[float, Unit("rad"), Range(-0.7, 2.6), "upper arm outward"],
        j3: Annotated[float, Unit("rad"), Range(-1.6, 1.6), "upper arm about itself, outward"],
        j4: Annotated[float, Unit("rad"), Range(0.1, 2.5), "elbow; 0 is stretched"],
        j5: Annotated[float, Unit("rad"), Range(-2.9, 2.9), "forearm about itself, outward"],
        j6: Annotated[float, Unit("rad"), Range(-1.9, 1.9), "wrist forward"],
        speed: Annotated[float, Unit("m/s"), Range(0.01, 0.8), "of the hand"] = 0.25,
        *,
        within: Within = None,
    ) -> None:
        """Bring the six joints to angles; the same angles look the same, mirrored, on both arms."""
        raise NotImplementedError
