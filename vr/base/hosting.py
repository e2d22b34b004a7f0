"""Hosts as places for robots: what a host has to do, and how its robots may be moved."""

from __future__ import annotations

from typing import Literal

import msgspec

Placement = Literal["manual", "advise", "auto"]
"""manual: only people and the page itself move a robot. advise: it says where it would be better off. auto:
it moves there."""

PLACEMENTS: tuple[Placement, ...] = ("manual", "advise", "auto")


class HostLoad(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a host has to do."""

    robots: int = 0
    running: int = 0
    """Commands that run in it."""
    cpu: float = 0.0
    """Part of one processor that its process has used of late."""
    room: int | None = None
    """Robots that it still takes; None: any number."""
