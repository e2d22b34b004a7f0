"""The interface of Rover. Written by `python docs/kinds.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from robotree.vr import Kind, Range, Unit, Within, promised


@dataclass(kw_only=True)
class RoverInfo:
    """Values by name."""

    x: Annotated[float, Unit("m"), "forward from the middle of the floor"]
    y: Annotated[float, Unit("m"), "to the left of it"]
    vx: Annotated[float, Unit("m/s"), "forward"]
    vy: Annotated[float, Unit("m/s"), "to the left"]


class Rover(Kind):
    """A rover: it moves by a distance, forward and aside."""

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
    def get_info(self, *, within: Within = None) -> RoverInfo:
        """Tell place and speed."""
        raise NotImplementedError
