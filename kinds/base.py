"""The interface of Base. Written by `python docs/kinds.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from robotree.vr import Kind, Range, Unit, Within, promised


@dataclass(kw_only=True)
class BaseInfo:
    """Values by name."""

    x: Annotated[float, Unit("m"), "forward from the middle of the floor"]
    y: Annotated[float, Unit("m"), "to the left of it"]
    vx: Annotated[float, Unit("m/s"), "forward"]
    vy: Annotated[float, Unit("m/s"), "to the left"]
    heading: Annotated[
        float,
        Unit("rad"),
        Range(-6.283185307179586, 6.283185307179586),
        "counterclockwise from x of the flat",
    ]
    lean: Annotated[float, Unit("rad"), "of the waist, forward"]
    balance: Annotated[float, Unit("m"), "by which the weight stays inside the wheels when it brakes"]
    nearest: Annotated[float, Unit("m"), "to the nearest person"]
    battery: Annotated[float, "how full, 0 to 1"]
    charging: bool


class Base(Kind):
    """The base of a companion: it drives around what is in the way, turns, leans its waist, and charges."""

    @promised(effect="read")
    def halt(self, *, within: Within = None) -> None:
        """Stop moving and stay here, compliantly; the next command may move again."""
        raise NotImplementedError

    @promised
    def move(
        self,
        x: Annotated[float, Unit("m"), Range(-3.0, 3.0), "forward; negative: backward"],
        y: Annotated[float, Unit("m"), Range(-3.0, 3.0), "to the left; negative: to the right"],
        speed: Annotated[float, Unit("m/s"), Range(0.01, 1.0), "along the way"] = 0.4,
        *,
        within: Within = None,
    ) -> None:
        """Move by a distance from here, without turning."""
        raise NotImplementedError

    @promised(effect="read")
    def get_info(self, *, within: Within = None) -> BaseInfo:
        """Tell place, speed, lean, balance and battery."""
        raise NotImplementedError

    @promised(effect="repeat")
    def drive(
        self,
        x: Annotated[float, Unit("m"), Range(-6.0, 6.0), "of the flat, forward from its middle"],
        y: Annotated[float, Unit("m"), Range(-6.0, 6.0), "of the flat, to the left of its middle"],
        heading: Annotated[
            float,
            Unit("rad"),
            Range(-6.283185307179586, 6.283185307179586),
            "counterclockwise from x of the flat",
        ],
        speed: Annotated[float, Unit("m/s"), Range(0.01, 0.8), "along the way; slower near people"] = 0.4,
        *,
        within: Within = None,
    ) -> None:
        """Drive to a place, around what stands in the way, and turn."""
        raise NotImplementedError

    @promised(effect="repeat")
    def turn(
        self,
        heading: Annotated[
            float,
            Unit("rad"),
            Range(-6.283185307179586, 6.283185307179586),
            "counterclockwise from x of the flat",
        ],
        *,
        within: Within = None,
    ) -> None:
        """Turn on the spot."""
        raise NotImplementedError

    @promised(effect="repeat")
    def lean(
        self,
        angle: Annotated[float, Unit("rad"), Range(-0.1, 0.7), "forward"],
        *,
        within: Within = None,
    ) -> None:
        """Lean the waist forward."""
        raise NotImplementedError
