"""The past out of the events of several hosts: why a robot moved, and its calls as spans. Pure."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import msgspec

from robotree.vr.base.history_event import HistoryEvent

# -- why a robot moved: from a call up to who asked for it -------------------------------------------


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


# -- calls as spans ----------------------------------------------------------------------------------


class CallSpan(msgspec.Struct, frozen=True, kw_only=True):
    """One call that has ended."""

    name: str
    """`arm.go_to`."""
    trace: int
    """128 bits, from the key of the command at the top."""
    span: int
    """64 bits, from the key of the call."""
    parent: int
    """Of the call above it; 0: it is at the top."""
    begin: int
    """[ns] since 1970, when it was accepted."""
    end: int
    error: str
    """As a sentence; empty: it ended well."""
    attributes: dict[str, Any]


def spans_of(events: Iterable[HistoryEvent]) -> list[CallSpan]:
    """Return the calls among events that were accepted and have ended, the oldest first.

    A command with all that it caused is one trace, whoever exports its parts: identifiers follow from the
    keys of the calls, so hosts that export apart from each other agree.
    """
    accepted: dict[tuple[str, str], HistoryEvent] = {}
    found: list[CallSpan] = []
    for event in events:
        if event.kind == "accepted":
            accepted[event.robot, event.key] = event
        elif event.kind == "ended" and (call := accepted.pop((event.robot, event.key), None)) is not None:
            found.append(_span(call, event))
    return sorted(found, key=lambda span: span.begin)


def _span(call: HistoryEvent, ended: HistoryEvent) -> CallSpan:
    above = call.key.rpartition("/")[0]
    attributes = {
        "robotree.key": call.key,
        "robotree.caller": call.person or call.caller,
        "robotree.epoch": call.epoch,
        "robotree.page": call.page,
        "robotree.line": call.line,
        "robotree.began": ended.began,
        "robotree.arguments": msgspec.json.encode(call.arguments).decode(),
    }
    return CallSpan(
        name=f"{call.robot}.{call.command}",
        trace=_number(call.key.partition("/")[0], 16),
        span=_number(call.key, 8),
        parent=_number(above, 8) if above else 0,
        begin=round(call.unix * 1e9),
        end=round(ended.unix * 1e9),
        error=f"{ended.error}: {ended.text}" if ended.error else "",
        attributes=attributes,
    )


def _number(key: str, size: int) -> int:
    """Return a number other than 0 that follows from a key; `size` [bytes]."""
    return int.from_bytes(hashlib.sha256(key.encode()).digest()[:size], "big") or 1
