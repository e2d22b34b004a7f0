"""The interface of Companion. Written by `python docs/kinds.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from robotree.vr import Kind, Range, Unit, Within, promised


@dataclass(kw_only=True)
class CompanionListenResult:
    """Values by name."""

    number: Annotated[int, "grows by one with each text; 0: nothing was heard yet"]
    speaker: Annotated[int, "tag of who spoke; 0: unknown"]
    text: str


@dataclass(kw_only=True)
class CompanionHeardResult:
    """Values by name."""

    number: Annotated[int, "grows by one with each text; 0: nothing was heard yet"]
    speaker: Annotated[int, "tag of who spoke; 0: unknown"]
    text: str


class Companion(Kind):
    """A robot that receives visitors, shows them the way and hands them a cup."""

    @promised(effect="read")
    def play(
        self,
        role: Annotated[str, "butler, maid, man, woman, child, neutral, or one that it has learned"],
        at: Annotated[str, "path of child slots to the robot that is meant; empty: this one"] = "",
        *,
        within: Within = None,
    ) -> str:
        """Play a role from the next act on; what runs now goes on as it began."""
        raise NotImplementedError

    @promised(effect="read")
    def learn_role(
        self,
        source: Annotated[str, "a role as YAML"],
        at: Annotated[str, "as in play"] = "",
        *,
        within: Within = None,
    ) -> str:
        """Learn a role, so that it can be played; returns its name."""
        raise NotImplementedError

    @promised(effect="read")
    def roles(self, *, within: Within = None) -> str:
        """Tell which role it plays, and which ones it knows."""
        raise NotImplementedError

    @promised
    def say(
        self,
        text: Annotated[str, "what to say, up to 200 bytes"],
        *,
        within: Within = None,
    ) -> str:
        """Say a phrase as the present role words it; returns when it is said."""
        raise NotImplementedError

    @promised(effect="repeat")
    def look_at(
        self,
        what: Annotated[
            str,
            "a place, a thing or a person by name: door, sofa, table, shelf, middle, dock, red cup, green cup, blue cup, anna, bela, cleo",
        ],
        *,
        within: Within = None,
    ) -> None:
        """Turn the head to something."""
        raise NotImplementedError

    @promised(effect="repeat")
    def nod(
        self,
        times: Annotated[int, Range(1, 10), "how often"] = 2,
        *,
        within: Within = None,
    ) -> None:
        """Nod."""
        raise NotImplementedError

    @promised(effect="repeat")
    def shake_head(
        self,
        times: Annotated[int, Range(1, 10), "how often"] = 2,
        *,
        within: Within = None,
    ) -> None:
        """Shake the head."""
        raise NotImplementedError

    @promised(effect="read")
    def see(
        self,
        what: Annotated[
            str,
            "a place, a thing or a person by name: door, sofa, table, shelf, middle, dock, red cup, green cup, blue cup, anna, bela, cleo",
        ],
        *,
        within: Within = None,
    ) -> bool:
        """Tell whether it has been seen in the last two seconds."""
        raise NotImplementedError

    @promised(effect="repeat")
    def wave(
        self,
        times: Annotated[int, Range(1, 10), "how often"] = 3,
        height: Annotated[float, Range(0.0, 1.0), "0 to 1"] = 0.8,
        *,
        within: Within = None,
    ) -> None:
        """Wave with the right hand, and let it hang again."""
        raise NotImplementedError

    @promised(effect="repeat")
    def bow(
        self,
        depth: Annotated[float, Unit("rad"), Range(0.0, 0.6), "how deep"] = 0.3,
        *,
        within: Within = None,
    ) -> None:
        """Bow from the waist, and stand upright again."""
        raise NotImplementedError

    @promised(effect="repeat")
    def point_at(
        self,
        what: Annotated[
            str,
            "a place, a thing or a person by name: door, sofa, table, shelf, middle, dock, red cup, green cup, blue cup, anna, bela, cleo",
        ],
        *,
        within: Within = None,
    ) -> Literal["left", "right"]:
        """Look at something and stretch an arm towards it; `rest` takes the arm down."""
        raise NotImplementedError

    @promised(effect="repeat")
    def rest(self, *, within: Within = None) -> None:
        """Let the arms hang, stand upright and look ahead; a hand that holds something stays level."""
        raise NotImplementedError

    @promised(effect="repeat")
    def go_to(
        self,
        place: Annotated[Literal["door", "sofa", "table", "shelf", "middle", "dock"], "a place by name"],
        speed: Annotated[float, Unit("m/s"), Range(0.05, 0.8), "of the base; slower near people"] = 0.5,
        *,
        within: Within = None,
    ) -> None:
        """Go to a place by its name."""
        raise NotImplementedError

    @promised(effect="repeat")
    def turn_to(
        self,
        what: Annotated[
            str,
            "a place, a thing or a person by name: door, sofa, table, shelf, middle, dock, red cup, green cup, blue cup, anna, bela, cleo",
        ],
        *,
        within: Within = None,
    ) -> None:
        """Turn the whole body to something."""
        raise NotImplementedError

    @promised
    def follow(
        self,
        who: Annotated[str, "a person by name: anna, bela, cleo"],
        seconds: Annotated[float, Unit("s"), Range(0.0, 3600.0), "how long"] = 20.0,
        distance: Annotated[float, Unit("m"), Range(0.5, 3.0), "to the person"] = 1.0,
        *,
        within: Within = None,
    ) -> None:
        """Go after a person, at a distance, until the time is over."""
        raise NotImplementedError

    @promised
    def approach(
        self,
        who: Annotated[str, "a person by name: anna, bela, cleo"],
        distance: Annotated[float, Unit("m"), Range(0.5, 3.0), "to the person"] = 1.1,
        *,
        within: Within = None,
    ) -> None:
        """Go to a person and stop at a distance, face to face."""
        raise NotImplementedError

    @promised
    def charge(
        self,
        until: Annotated[float, Range(0.0, 1.0), "0 to 1"] = 0.9,
        *,
        within: Within = None,
    ) -> float:
        """Go to the charging place and stay until the battery is as full as asked for."""
        raise NotImplementedError

    @promised(effect="repeat")
    def reach(
        self,
        x: Annotated[float, Unit("m"), Range(-3.0, 3.0), "of the flat"],
        y: Annotated[float, Unit("m"), Range(-2.4, 2.4), "of the flat"],
        z: Annotated[float, Unit("m"), Range(0.2, 1.7), "above the floor"],
        *,
        within: Within = None,
    ) -> Literal["left", "right"]:
        """Bring a hand to a point of the flat, the one that is nearer; the base stays."""
        raise NotImplementedError

    @promised
    def take(
        self,
        what: Annotated[Literal["red cup", "green cup", "blue cup"], "a thing by name"],
        *,
        within: Within = None,
    ) -> Literal["left", "right"]:
        """Go to a thing, take it, lift it, and step back."""
        raise NotImplementedError

    @promised
    def give(
        self,
        who: Annotated[str, "a person by name: anna, bela, cleo"],
        *,
        within: Within = None,
    ) -> None:
        """Offer what a hand holds, set it on the person's open palm, and let go once the palm carries it."""
        raise NotImplementedError

    @promised
    def put(
        self,
        place: Annotated[
            Literal["door", "sofa", "table", "shelf", "middle", "dock"], "a place by name"
        ] = "table",
        *,
        within: Within = None,
    ) -> None:
        """Put what a hand holds down on the table, away from all that stands there."""
        raise NotImplementedError

    @promised(effect="read")
    def holding(self, *, within: Within = None) -> Literal["nothing", "left", "right", "both"]:
        """Tell which hands hold something."""
        raise NotImplementedError

    @promised(effect="read")
    def where(
        self,
        what: Annotated[Literal["red cup", "green cup", "blue cup"], "a thing by name"],
        *,
        within: Within = None,
    ) -> str:
        """Tell where a thing is: left or right (hand), table, floor, who has it, away (else), or unseen."""
        raise NotImplementedError

    @promised(effect="read")
    def listen(
        self,
        after: Annotated[int, Range(0, 2147483648), "number of the text that was heard last"],
        within: Annotated[float, Unit("s"), Range(0.0, 600.0), "how long to wait"] = 10.0,
    ) -> CompanionListenResult:
        """Wait for a text that is newer than one; the same one again if none comes in time."""
        raise NotImplementedError

    @promised(effect="read")
    def heard(self, *, within: Within = None) -> CompanionHeardResult:
        """Tell what was heard last."""
        raise NotImplementedError
