"""The interface of Head. Written by `python docs/kinds.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from robotree.vr import Kind, Range, Unit, Within, promised


@dataclass(kw_only=True)
class HeadHeardResult:
    """Values by name."""

    number: Annotated[int, "grows by one with each text; 0: nothing was heard yet"]
    speaker: Annotated[int, "tag of who spoke; 0: unknown"]
    text: str


@dataclass(kw_only=True)
class HeadListenResult:
    """Values by name."""

    number: Annotated[int, "grows by one with each text; 0: nothing was heard yet"]
    speaker: Annotated[int, "tag of who spoke; 0: unknown"]
    text: str


@dataclass(kw_only=True)
class HeadSeeResult:
    """Values by name."""

    x: Annotated[float, Unit("m"), "of the flat"]
    y: Annotated[float, Unit("m"), "of the flat"]
    z: Annotated[float, Unit("m"), "above the floor"]
    age: Annotated[float, Unit("s"), "since it was seen"]
    seen: Annotated[bool, "whether it ever was"]


@dataclass(kw_only=True)
class HeadInfo:
    """Values by name."""

    pan: Annotated[float, Unit("rad"), Range(-1.7, 1.7), "to the left"]
    tilt: Annotated[float, Unit("rad"), Range(-0.6, 0.8), "downward"]
    heard: Annotated[int, "how many texts were heard so far"]
    tags: Annotated[int, "how many tags were seen in the last 2 s"]


class Head(Kind):
    """A head: it looks, sees tags with two cameras, speaks and listens."""

    @promised(effect="read")
    def halt(self, *, within: Within = None) -> None:
        """Stop moving and stay here, compliantly; the next command may move again."""
        raise NotImplementedError

    @promised(effect="repeat")
    def look(
        self,
        pan: Annotated[float, Unit("rad"), Range(-1.7, 1.7), "to the left"],
        tilt: Annotated[float, Unit("rad"), Range(-0.6, 0.8), "downward"],
        rate: Annotated[float, Unit("rad/s"), Range(0.05, 3.0), "of the neck"] = 1.5,
        *,
        within: Within = None,
    ) -> None:
        """Turn the head."""
        raise NotImplementedError

    @promised
    def say(
        self,
        text: Annotated[str, "what to say, up to 200 bytes"],
        *,
        within: Within = None,
    ) -> None:
        """Say something aloud."""
        raise NotImplementedError

    @promised(effect="read")
    def heard(self, *, within: Within = None) -> HeadHeardResult:
        """Tell what was heard last."""
        raise NotImplementedError

    @promised(effect="read")
    def listen(
        self,
        after: Annotated[int, Range(0, 2147483648), "number of the text that was heard last"],
        within: Annotated[float, Unit("s"), Range(0.0, 600.0), "how long to wait"] = 10.0,
    ) -> HeadListenResult:
        """Wait for a text that is newer than one; the same one again if none comes in time."""
        raise NotImplementedError

    @promised(effect="read")
    def see(
        self,
        tag: Annotated[int, Range(1, 255), "number of the tag"],
        *,
        within: Within = None,
    ) -> HeadSeeResult:
        """Tell where a tag was seen last."""
        raise NotImplementedError

    @promised(effect="read")
    def get_info(self, *, within: Within = None) -> HeadInfo:
        """Tell how it looks, and what it knows."""
        raise NotImplementedError
