"""How a robot is absent, in words: one wording for the command line and the full screen.

Five kinds are told apart: it is here; its controller is off; its process hangs; it is away since a time; it
was deleted and never comes back. The first three the robot or its neighbours say; this is about the others.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import TYPE_CHECKING

from robotree.tui.seen.status import span

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.order import KnownAgent, OrderHold

DAY = 86400.0
"""[s]"""


def how(known: KnownAgent, now: float) -> str:
    """Return how a robot that is not here is absent, with its age; `now` [s] since 1970."""
    if known.deleted:
        return f"deleted, {age(known.deleted, now)}"
    return f"away since {clock(known.seen)} ({span(max(now - known.seen, 0.0))})"


def with_holds(known: KnownAgent, holds: Iterable[OrderHold], now: float) -> str:
    """Return the same, and which stop keeps it from beginning what was ordered, if one does."""
    held = next((hold for hold in holds if hold.holds(known.identity)), None)
    return f"{how(known, now)}, held by {held.by}" if held and not known.deleted else how(known, now)


def age(time_of: float, now: float) -> str:
    """Write how long ago something was."""
    return f"{span(max(now - time_of, 0.0))} ago"


def clock(unix: float) -> str:
    """Write a time: of this day only the hour, else the date, too."""
    if not unix:
        return "-"
    form = "%H:%M:%S" if abs(time.time() - unix) < DAY / 2 else "%m-%d %H:%M"
    return time.strftime(form, time.localtime(unix))


def names(labels: Iterable[str]) -> str:
    """Return the names of directories from what stands in an order."""
    return ", ".join(label.partition(".")[0] for label in labels) or "nobody"
