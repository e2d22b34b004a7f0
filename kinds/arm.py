"""The interface of Arm. Written by `python docs/kinds.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from robotree.vr import Kind, Range, Unit, Within, promised


@dataclass(kw_only=True)
class ArmInfo:
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


class Arm(Kind):
    """A compliant arm: goes to points, gripper down, yields when pushed, and feels what it touches."""

    @promised(effect="read")
    def halt(self, *, within: Within = None) -> None:
        """Stop moving and stay here, compliantly; the next command may move again."""
        raise NotImplementedError

    @promised(effect="repeat")
    def go_to(
        self,
        x: Annotated[float, Unit("m"), Range(-0.65, 0.65), "forward, from the foot of the arm"],
        y: Annotated[float, Unit("m"), Range(-0.65, 0.65), "to the left"],
        z: Annotated[float, Unit("m"), Range(0.025, 0.8), "up, from the table"],
        twist: Annotated[
            float,
            Unit("rad"),
            Range(-3.141592653589793, 3.141592653589793),
            "of the gripper, counterclockwise from above",
        ],
        speed: Annotated[
            float, Unit("m/s"), Range(0.005, 0.25), "along the way; slower where contact is expected"
        ] = 0.15,
        blend: Annotated[
            float,
            Unit("m"),
            Range(0.0, 0.05),
            "from the point, at which it counts as reached in passing; 0: the tool stands there",
        ] = 0.0,
        *,
        within: Within = None,
    ) -> None:
        """Move the gripper to a point, on a line if there is one, and turn it."""
        raise NotImplementedError

    @promised(effect="read")
    def get_info(self, *, within: Within = None) -> ArmInfo:
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
