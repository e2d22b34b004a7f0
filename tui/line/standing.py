"""The verb `where`: where a robot is in its page now."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from robotree.tui.line.grammar import Line
from robotree.tui.line.past import kept_events
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.seen import wording
from robotree.tui.seen.standing import ChildStep, Standing, standing, times

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.history_event import HistoryEvent
    from robotree.vr.supervision.realm_client import RealmClient

FAMILY = 16
"""Robots below one whose events are asked for, at most."""
EVENTS = 1000
"""Events of one robot that are looked at, the latest."""
AROUND = 2
"""Lines of the page that are shown above and below the one at which it is."""


async def where(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Tell where a robot is."""
    from robotree.vr.base.errors import NoHistory

    name = line.text("NAME")
    found, notes = await find(realm_client, name)
    for note in notes:
        teller.warn(note)
    if found is None:
        raise NoHistory(name=name, detail="; it has carried nothing out, or only what reads")
    source = await page_of(realm_client, name)
    now = time.time()
    data = {**plain(found), "runs": found.runs, "times": [
        {"call": call, "count": count, "seconds": seconds} for call, count, seconds in times(found, now)
    ]}  # fmt: skip
    return Outcome(data, "\n".join(lines(found, source, now)))


async def find(realm_client: RealmClient, name: str) -> tuple[Standing | None, tuple[str, ...]]:
    """Return where a robot is, and what may be missing, as sentences.

    Raises:
        VrError: it does not answer.
    """
    from robotree.vr.base.address import parted
    from robotree.vr.base.requests import ReadEvents

    own = await kept_events(realm_client, ReadEvents(robot=name, most=EVENTS))
    events: list[HistoryEvent] = [event for _, event in own.events()]
    robot = await realm_client.describe(name)
    first = standing(parted(name)[1], events)
    if first is None:
        return None, own.notes
    seen, ahead = {name}, [slot.child.name for slot in robot.slots if slot.child]
    while ahead and len(seen) <= FAMILY:
        child = ahead.pop(0)
        if child in seen:
            continue
        seen.add(child)
        kept = await kept_events(realm_client, ReadEvents(robot=child, since=first.began - 1.0, most=EVENTS))
        events += [event for _, event in kept.events()]
        ahead += await _children(realm_client, child)
    return standing(parted(name)[1], events, held=robot.held), own.notes


async def _children(realm_client: RealmClient, name: str) -> Sequence[str]:
    from robotree.vr.base.errors import VrError

    try:
        robot = await realm_client.describe(name)
    except VrError:
        return ()
    return [slot.child.name for slot in robot.slots if slot.child]


async def page_of(realm_client: RealmClient, name: str) -> Sequence[str]:
    """Return the lines of the page that a robot runs; none: it has none, or its host does not say."""
    from robotree.vr.base.errors import VrError

    try:
        return (await realm_client.source(name)).splitlines()
    except VrError:
        return ()


# -- in words --------------------------------------------------------------------------------------


def call_words(robot: str, command: str, arguments: Mapping[str, Any]) -> str:
    """Write a call: `arm-1.go_to x=0.3`."""
    return " ".join(
        [f"{robot}.{command}", *(f"{key}={wording.value(one)}" for key, one in arguments.items())]
    )


def ended_words(took: float | None, error: str, value: Any) -> str:
    """Write how a call ended: `1.24 s  done`, `0.31 s  x 0.3`."""
    if took is None:
        return "goes on"
    result = error or ("done" if value is None else wording.value(value))
    return f"{took:.2f} s  {result}"


def head(found: Standing, now: float) -> str:
    """Write the command, who asked for it and for how long it has run."""
    call = call_words(found.robot, found.command, found.arguments)
    asked = f", asked for by {found.asked}" if found.asked else ""
    if found.held:
        return f"{call} is paused before {found.held}{asked}"
    if found.runs:
        return f"{call} has run for {now - found.began:.1f} s{asked}"
    return f"nothing runs; the last was {call}: {ended_words(found.took, found.error, found.value)}{asked}"


def step_words(step: ChildStep, now: float) -> str:
    """Write a call of a child, indented below the one that made it."""
    lead, line = "  " * step.depth, f"line {step.line}" if step.line else ""
    took = f"{now - step.began:.1f} s so far" if step.open else ended_words(step.took, step.error, step.value)
    sign = "▸" if step.open else "✗" if step.error else "✓"
    call = call_words(step.robot, step.command, step.arguments)
    return f"{lead}{sign} {step.step:<5} {call}  {took}  {line}".rstrip()


def excerpt(found: Standing, source: Sequence[str], around: int = AROUND) -> list[tuple[int, str]]:
    """Return the lines of the page around the one at which the robot is, with their numbers."""
    if not 0 < found.line <= len(source):
        return []
    first = max(found.line - around, 1)
    return list(enumerate(source[first - 1 : found.line + around], first))


def lines(found: Standing, source: Sequence[str], now: float) -> list[str]:
    """Write all that is known."""
    text = [head(found, now)]
    text += [f"{'→' if at == found.line else ' '} {at:>4}  {line}" for at, line in excerpt(found, source)]
    text += [step_words(step, now) for step in found.steps] or ["it has called no child yet"]
    if totals := times(found, now):
        text.append("time: " + ", ".join(f"{name} {count}x {took:.2f} s" for name, count, took in totals))
    return text
