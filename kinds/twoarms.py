"""The interface of TwoArms. Written by `python docs/kinds.py`."""

from __future__ import annotations

from typing import Annotated, Literal

from robotree.vr import Kind, Range, Unit, Within, promised


class TwoArms(Kind):
    """Two arms that do the same thing at the same time."""

    @promised
    def lift(
        self,
        height: Annotated[float, Unit("m"), Range(-0.2, 0.2), "how far up; negative: down"],
        *,
        within: Within = None,
    ) -> Annotated[float, Unit("m"), "how far apart they are in height"]:
        """Raise both grippers, each from where it is."""
        raise NotImplementedError

    @promised(effect="repeat")
    def grip(
        self,
        action: Literal["open", "close"],
        *,
        within: Within = None,
    ) -> None:
        """Open or close both grippers."""
        raise NotImplementedError
