"""The verb `where`: where a robot is in its page now."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from robotree.tui.line.grammar import Line
from robotree.tui.line.past import Known, call_words, commands_by_name, kept_events
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.seen import wording
from robotree.tui.seen.standing import ChildStep, Standing, standing, times

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.history_event import HistoryEvent
    from robotree.vr.supervision.realm_client import RealmClient

FAMILY = 16
"""Robots below one whose events are asked for, at most."""
EVENTS = 1000
"""Events of one robot that are looked at, the latest."""
NO_CALLS = "no call of a child is kept"
"""Said where there is none; those that only read are never kept."""

AROUND = 2
"""Lines of the page that are shown above and below the one at which it is."""


async def where(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Tell where a robot is."""
    from robotree.vr.base.errors import NoHistory

    name = line.text("NAME")
    found, notes, known = await find(realm_client, name)
    for note in notes:
        teller.warn(note)
    if found is None:
        raise NoHistory(name=name, detail="; it has carried nothing out, or only what reads")
    source = await page_of(realm_client, name)
    now = time.time()
    data = {**plain(found), "times": [
        {"call": call, "count": count, "seconds": seconds} for call, count, seconds in times(found, now)
    ]}  # fmt: skip
    return Outcome(data, "\n".join(lines(found, source, now, known)))


async def find(realm_client: RealmClient, name: str) -> tuple[Standing | None, tuple[str, ...], Known]:
    """Return where a robot is, what may be missing, as sentences, and the commands of all who take part.

    Raises:
        VrError: it does not answer.
    """
    from robotree.vr.base.address import parted
    from robotree.vr.base.errors import VrError
    from robotree.vr.base.requests import ReadEvents

    robot = await realm_client.describe(name)  # first: a command that has just ended has its end in the past
    own = await kept_events(realm_client, ReadEvents(robot=name, most=EVENTS))
    events: list[HistoryEvent] = [event for _, event in own.events()]
    place = partial(standing, parted(name)[1], held=robot.held, busy=robot.busy, waiting=robot.waiting)
    first, known = place(events), commands_by_name(robot)
    if first is None:
        return None, own.notes, known
    seen, ahead = {name}, _children(robot)
    while ahead and len(seen) <= FAMILY:
        child = ahead.pop(0)
        if child in seen:
            continue
        seen.add(child)
        kept = await kept_events(realm_client, ReadEvents(robot=child, since=first.began - 1.0, most=EVENTS))
        events += [event for _, event in kept.events()]
        with suppress(VrError):
            described = await realm_client.describe(child)
            known |= commands_by_name(described)
            ahead += _children(described)
    return place(events), own.notes, known


def _children(robot: RobotDescription) -> list[str]:
    """Return the names of its children, also of those that were lost: what they did is kept."""
    return [slot.child.name if slot.child else slot.was for slot in robot.slots if slot.child or slot.was]


async def page_of(realm_client: RealmClient, name: str) -> Sequence[str]:
    """Return the lines of the page that a robot runs; none: it has none, or its host does not say."""
    from robotree.vr.base.errors import VrError

    try:
        return (await realm_client.source(name)).splitlines()
    except VrError:
        return ()


# -- in words --------------------------------------------------------------------------------------


def _call_words(call: Standing | ChildStep, known: Known) -> str:
    return call_words(call.robot, call.command, call.arguments, known)


def ended_words(call: Standing | ChildStep, known: Known) -> str:
    """Write how a call ended: `1.24 s  done`, `0.31 s  x 0.3 m`, `14.30 s  result 2`."""
    if call.took is None:
        return "its end is not known: it was interrupted"
    if call.error or call.value is None:
        return f"{call.took:.2f} s  {call.error or 'done'}"
    spec = known.get(f"{call.robot}.{call.command}")
    rows = wording.result(spec.result if spec else (), call.value)
    result = ", ".join(f"{name or 'result'} {text}" for name, text in rows)
    return f"{call.took:.2f} s  {result or 'done'}"


def head(found: Standing, now: float, known: Known) -> str:
    """Write the command, who asked for it and for how long it has run."""
    call = _call_words(found, known)
    asked = f", asked for by {found.asked}" if found.asked else ""
    if found.held:
        return f"{call} is paused before {found.held}{asked}"
    if found.runs:
        return f"{call} has run for {now - found.began:.1f} s{asked}"
    return f"nothing runs; the last was {call}: {ended_words(found, known)}{asked}"


def step_words(step: ChildStep, now: float, known: Known) -> str:
    """Write a call of a child, indented below the one that made it."""
    lead, line = "  " * step.depth, f"line {step.line}" if step.line else ""
    took = f"{now - step.began:.1f} s so far" if step.open else ended_words(step, known)
    sign = "▸" if step.open else "?" if step.took is None else "✗" if step.error else "✓"
    return f"{lead}{sign} {step.step:<5} {_call_words(step, known)}  {took}  {line}".rstrip()


def excerpt(found: Standing, source: Sequence[str], around: int = AROUND) -> list[tuple[int, str]]:
    """Return the lines of the page around the one at which the robot is, with their numbers."""
    if not 0 < found.line <= len(source):
        return []
    first = max(found.line - around, 1)
    return list(enumerate(source[first - 1 : found.line + around], first))


def lines(found: Standing, source: Sequence[str], now: float, known: Known) -> list[str]:
    """Write all that is known."""
    text = [head(found, now, known)]
    text += [f"{'→' if at == found.line else ' '} {at:>4}  {line}" for at, line in excerpt(found, source)]
    text += [step_words(step, now, known) for step in found.steps] or [NO_CALLS]
    if totals := times(found, now):
        text.append("time: " + ", ".join(f"{name} {count}x {took:.2f} s" for name, count, took in totals))
    return text
