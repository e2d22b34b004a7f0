"""Where a robot is in its page now: the command, its calls of children, their results and times. Pure.

It is made from what hosts have kept (`HistoryEvent`): calls that only read are not kept, so the line is that
of the last call that was, unless the robot is paused, when it says itself before which step it waits.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, cast

import msgspec

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.history_event import HistoryEvent

_LINE = re.compile(r", line ([0-9]+)$")
"""Behind the step before which a paused robot waits."""


class ChildStep(msgspec.Struct, frozen=True, kw_only=True):
    """One call that a running command has made, or that such a call has made in its turn."""

    step: str
    """Which step of the command: `2`, or `2/1` for the first step of what that one called."""
    robot: str
    command: str
    arguments: Mapping[str, Any]
    line: int = 0
    """Of the caller's page; 0: not known."""
    began: float
    """[s] since 1970 when it was accepted."""
    took: float | None = None
    """[s]; None: it goes on, or its end is not known."""
    open: bool = False
    """Whether it goes on."""
    error: str = ""
    """Class of the error with which it ended."""
    value: Any = None
    """Its result, or the data of the error."""

    @property
    def depth(self) -> int:
        """How many calls are above it, without the command itself."""
        return self.step.count("/")


class Standing(msgspec.Struct, frozen=True, kw_only=True):
    """Where a robot is."""

    robot: str
    command: str
    key: str
    arguments: Mapping[str, Any]
    asked: str
    """The person or robot that asked for it."""
    began: float
    """[s] since 1970 when it was accepted."""
    took: float | None = None
    """[s]; None: it runs, or its end is not known."""
    runs: bool = False
    """Whether it goes on; else it is the last one that did."""
    error: str = ""
    value: Any = None
    held: str = ""
    """The step before which it waits, where it is paused."""
    line: int = 0
    """Of its page: where it is; 0: not known."""
    page: str = ""
    """Hash of the page."""
    steps: tuple[ChildStep, ...] = ()
    """The calls so far, the oldest first, each below the one that made it."""


def standing(
    robot: str,
    events: Iterable[HistoryEvent],
    *,
    held: str = "",
    busy: str | None = None,
    waiting: int = 0,
) -> Standing | None:
    """Return where a robot is.

    Args:
        robot: its name, without a site.
        events: of it and of those below it, in any order; several may have kept the same one.
        held: the step before which it waits, as its state says; empty: none.
        busy: the command that runs, as its state says; empty: none does, so that a call without an end was
            interrupted; None: its state is not known.
        waiting: how many commands wait for that one.

    Returns:
        The command that runs; where none does, the last one; None: nothing is kept of any.
    """
    accepted: dict[str, HistoryEvent] = {}
    ended: dict[str, HistoryEvent] = {}
    for event in events:
        if event.kind == "accepted":
            accepted.setdefault(event.key, event)
        elif event.kind == "ended" or (event.kind == "answered" and event.key not in ended):
            ended[event.key] = event
    own = [event for event in accepted.values() if event.robot == robot]
    if not own:
        return None
    own.sort(key=lambda event: event.unix)
    running = [event for event in own if event.key not in ended][-1 - waiting :]
    if busy is not None:  # the latest without an end are those that the robot has: earlier ones it has lost
        running = [event for event in running if event.command == busy]
    call, runs = [*running, own[-1]][0], bool(running)
    end = ended.get(call.key)
    below = [event for key, event in accepted.items() if key.startswith(f"{call.key}/")]
    steps = tuple(
        _step(event, ended.get(event.key), event.key[len(call.key) + 1 :], runs=runs)
        for event in sorted(below, key=lambda event: (_numbers(event.key), event.unix))
    )
    return Standing(
        robot=robot,
        command=call.command,
        key=call.key,
        arguments=_given(call.arguments),
        asked=call.person or call.caller,
        began=call.unix,
        took=None if end is None else max(end.unix - call.unix, 0.0),
        error="" if end is None else end.error,
        value=None if end is None else end.value,
        runs=runs,
        held=held if runs else "",
        line=_line(held, steps) if runs else 0,
        page=call.page,
        steps=steps,
    )


def _step(call: HistoryEvent, end: HistoryEvent | None, step: str, *, runs: bool) -> ChildStep:
    return ChildStep(
        step=step,
        robot=call.robot,
        command=call.command,
        arguments=_given(call.arguments),
        line=call.line,
        began=call.unix,
        took=None if end is None else max(end.unix - call.unix, 0.0),
        open=runs and end is None,
        error="" if end is None else end.error,
        value=None if end is None else end.value,
    )


def _given(arguments: Any) -> Mapping[str, Any]:
    return cast("dict[str, Any]", arguments) if isinstance(arguments, dict) else {}


def _numbers(key: str) -> list[tuple[int, str]]:
    """Return what sorts keys by their steps: 2 before 10."""
    parts = key.split("/")
    return [(int(part) if part.isdigit() else 0, part) for part in parts]


def _line(held: str, steps: Iterable[ChildStep]) -> int:
    """Return the line at which a command is: of the step that waits, of its open call, or of the last one."""
    if found := _LINE.search(held):
        return int(found[1])
    own = [step for step in steps if not step.depth]
    still = [step for step in own if step.open]
    return next((step.line for step in reversed(still or own)), 0)


def times(found: Standing, now: float) -> list[tuple[str, int, float]]:
    """Return for each call of a child how often it was made, and how long that took together [s].

    Args:
        found: where the robot is.
        now: [s] since 1970, for calls that go on.
    """
    total: dict[str, tuple[int, float]] = {}
    for step in found.steps:
        if step.depth:
            continue
        name = f"{step.robot}.{step.command}"
        count, seconds = total.get(name, (0, 0.0))
        took = max(now - step.began, 0.0) if step.open else step.took or 0.0
        total[name] = (count + 1, seconds + took)
    ordered = sorted(total.items(), key=lambda one: -one[1][1])
    return [(name, count, seconds) for name, (count, seconds) in ordered]
