"""The object of keys: a robot, an empty slot, or nothing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Place:
    """A robot and the slot that it is in, or a slot that is empty."""

    name: str
    """The robot in this place; empty: nobody."""
    parent: str = ""
    slot: str = ""


NOWHERE = Place("")
"""Nothing is selected."""
