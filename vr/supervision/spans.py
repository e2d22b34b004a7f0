"""Calls as spans: a command with all that it caused is one trace, whoever exports its parts. Pure.

Identifiers follow from the keys of the calls, so hosts that export apart from each other agree.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import msgspec

from robotree.vr.base.history_event import HistoryEvent


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
    """Return the calls among events that were accepted and have ended, the oldest first."""
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
