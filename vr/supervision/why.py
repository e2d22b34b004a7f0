"""Why a robot moved: from a call up to who asked for it, out of the events of several hosts. Pure."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from robotree.vr.base.history_event import HistoryEvent


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """One call on the way from a motion to who asked for it."""

    call: HistoryEvent
    """As it was accepted."""
    source: str
    """The process that has kept it, in words: `host h1`."""
    step: str = ""
    """Which step of the call above it is: what its key adds to that one's; empty: there is none above."""
    ended: HistoryEvent | None = None
    """None: it goes on, or nobody has kept its end."""
    answered: HistoryEvent | None = None
    """The answer that its caller has received, where that is in another process."""
    observed: tuple[HistoryEvent, ...] = ()
    back: tuple[HistoryEvent, ...] = ()
    """The crashes of its host after which it went on, and its moves."""


class Chain(msgspec.Struct, frozen=True, kw_only=True):
    """All calls from a motion up."""

    links: tuple[Link, ...]
    """The motion itself first."""
    missing: str = ""
    """The caller of the uppermost one, if nothing of that is kept; empty: a person, or the robot itself."""

    @property
    def person(self) -> str:
        """The person at the top; empty: not known."""
        top = self.links[-1].call
        return "" if self.missing else top.person or top.caller


def last_motion(found: Iterable[HistoryEvent], robot: str) -> str:
    """Return the key of the latest call of a robot; empty: there is none."""
    accepted = [event for event in found if event.kind == "accepted" and event.robot == robot]
    return max(accepted, key=lambda event: event.unix).key if accepted else ""


def explain(key: str, found: Iterable[tuple[str, HistoryEvent]]) -> Chain | None:
    """Return the calls that led to a call.

    Args:
        key: of the call.
        found: events of it and of those above it, each with who has kept it.

    Returns:
        None: nothing is kept of it.
    """
    by_key: dict[str, list[tuple[str, HistoryEvent]]] = {}
    for source, event in found:
        by_key.setdefault(event.key, []).append((source, event))
    links: list[Link] = []
    below, at = "", key
    while at:
        of_key = sorted(by_key.get(at, ()), key=lambda kept: kept[1].unix)
        kept = [kept for kept in of_key if kept[1].kind == "accepted"]
        if kept:
            if links:
                links[-1] = msgspec.structs.replace(links[-1], step=below[len(at) + 1 :])
            source, call = kept[-1]
            robot = call.robot
            links.append(
                Link(
                    call=call,
                    source=source,
                    ended=_latest(of_key, "ended", robot),
                    answered=_latest(of_key, "answered"),
                    observed=tuple(event for _, event in of_key if event.kind == "observed"),
                    back=tuple(event for _, event in of_key if event.kind in ("back", "moved")),
                )
            )
            below = at
        elif at == key:
            return None
        at = at.rpartition("/")[0]
    top = links[-1].call
    return Chain(links=tuple(links), missing=top.caller if "/" in top.key else "")


def _latest(kept: Iterable[tuple[str, HistoryEvent]], kind: str, robot: str = "") -> HistoryEvent | None:
    events = [event for _, event in kept if event.kind == kind and robot in ("", event.robot)]
    return events[-1] if events else None
