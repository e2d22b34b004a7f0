"""The commands of a rehearsal, in the order in which they were accepted, and how each ended.

It is the robots' own journal: an entry is made when the core of a robot accepts a call, after its checks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, overload

import msgspec

from robotree.vr.base.requests import Returned
from robotree.vr.core import events as on
from robotree.vr.core.events import CoreEvent

ROUNDING = 1e-9
"""By which numbers may differ and still count as the same: 30 cm are 0.30000000000000004 m."""

Entry = tuple[str, str, dict[str, Any]]
"""Robot, command, and the arguments that were given, in the units that the command declares."""


class Step(msgspec.Struct, kw_only=True):
    """One call of one robot."""

    at: float
    """[s] of virtual time since the rehearsal began."""
    robot: str
    """Slot of the robot, `mover.arm` for one further down; empty: the page itself."""
    command: str
    arguments: dict[str, Any]
    """Those that were given, in declared units."""
    reads: bool
    """Whether the command only reads."""
    key: str
    ended: float = math.nan
    """[s] when; NaN: it has not."""
    error: str = ""
    """Class of the error with which it ended; empty: it has succeeded, or not ended."""

    @property
    def entry(self) -> Entry:
        """The step as `Commanded` compares it."""
        return self.robot, self.command, self.arguments

    def __str__(self) -> str:
        end = " (not ended)" if math.isnan(self.ended) else f" -> {self.error}" if self.error else ""
        return f"{self.at:8.3f} s  {line_of(self.entry)}{end}"


class Commanded(Sequence[Entry]):
    """A list of what was commanded. It equals a list of tuples when the numbers agree to 1e-9."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        """Take the entries."""
        self._entries = list(entries)

    def __len__(self) -> int:
        return len(self._entries)

    @overload
    def __getitem__(self, index: int) -> Entry: ...
    @overload
    def __getitem__(self, index: slice) -> Commanded: ...
    def __getitem__(self, index: int | slice) -> Entry | Commanded:
        return Commanded(self._entries[index]) if isinstance(index, slice) else self._entries[index]

    def __iter__(self) -> Iterator[Entry]:
        return iter(self._entries)

    def __contains__(self, entry: object) -> bool:
        return any(same(entry, each) for each in self._entries)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, list | tuple | Commanded) and same(self._entries, [*other])

    __hash__ = None  # type: ignore[assignment] # it is compared by value

    def __repr__(self) -> str:
        return "\n".join(["commanded:", *(f"  {line_of(entry)}" for entry in self._entries)])

    def of(self, robot: str) -> Commanded:
        """Return what one robot was commanded."""
        return Commanded(entry for entry in self._entries if entry[0] == robot)

    @property
    def names(self) -> list[str]:
        """The commands alone, as `arm.go_to`."""
        return [f"{robot}.{command}" for robot, command, _ in self._entries]


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal but for the rounding of numbers."""
    if _both(bool, one, other):
        return bool(one == other)
    if _both((int, float), one, other):
        return math.isclose(one, other, rel_tol=ROUNDING, abs_tol=ROUNDING)
    if _both(Mapping, one, other):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if _both((list, tuple), one, other):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and bool(one == other)


def _both(kinds: type[Any] | tuple[type[Any], ...], one: Any, other: Any) -> bool:
    return isinstance(one, kinds) and isinstance(other, kinds)


def line_of(entry: Any) -> str:
    """Return an entry as a line of Python: `arm.go_to(x=0.3, y=0)`."""
    try:
        robot, command, arguments = entry
        given = ", ".join(f"{name}={_short(value)}" for name, value in arguments.items())
    except (TypeError, ValueError, AttributeError):
        return repr(entry)
    return f"{robot}.{command}({given})" if robot else f"{command}({given})"


def difference(commanded: Sequence[Any], expected: Sequence[Any]) -> list[str]:
    """Return lines that show where two lists differ: `=` the same, `-` expected, `+` commanded instead."""
    left, right = list(commanded), list(expected)
    lines: list[str] = []
    here, there = 0, 0
    for begins, expects, length in _common(left, right):
        lines += [f"- {line_of(entry)}" for entry in right[there:expects]]
        lines += [f"+ {line_of(entry)}" for entry in left[here:begins]]
        lines += [f"= {line_of(entry)}" for entry in left[begins : begins + length]]
        here, there = begins + length, expects + length
    return lines


def _common(left: list[Any], right: list[Any]) -> list[tuple[int, int, int]]:
    """Return the runs that both lists have in common, as `difflib` does, and an empty one at the end."""
    numbers: list[Any] = []

    def number(entry: Any) -> int:
        for index, known in enumerate(numbers):
            if same(entry, known):
                return index
        numbers.append(entry)
        return len(numbers) - 1

    import difflib

    one, other = [number(entry) for entry in left], [number(entry) for entry in right]
    blocks = difflib.SequenceMatcher(None, one, other, autojunk=False).get_matching_blocks()
    return [(block.a, block.b, block.size) for block in blocks]


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


class Journal:
    """Takes the events of all robots of a rehearsal: a `running.process.Journal` that keeps calls."""

    def __init__(self, paths: Mapping[str, str], now: Callable[[], float]) -> None:
        """Begin empty.

        Args:
            paths: slot of each robot by its name; grows.
            now: [s] since the rehearsal began, for all robots alike.
        """
        self.steps: list[Step] = []
        self.on_step: Callable[[Step], None] = lambda _: None
        """Told of each new step; must not wait."""
        self._paths, self._now = paths, now
        self._by_key: dict[tuple[str, str], Step] = {}

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        del now  # of the robot's own process
        if isinstance(event, on.Invoke):
            self._begin(robot, event)
        elif isinstance(event, on.Finish):
            self._end(robot, event)

    def commit(self) -> None:
        """Nothing waits: this journal is in memory."""

    def arguments(self, robot: str, key: str) -> Mapping[str, Any]:
        """Return the arguments that were given in a call."""
        step = self._by_key.get((robot, key))
        return {} if step is None else step.arguments

    def _begin(self, robot: str, event: on.Invoke) -> None:
        call = event.call
        if (robot, call.key) in self._by_key:  # the same call, sent again
            return
        step = Step(
            at=self._now(),
            robot=self._paths.get(robot.split("/")[1], robot),
            command=call.command,
            arguments=dict(event.arguments),
            reads=event.reads,
            key=call.key,
        )
        self._by_key[robot, call.key] = step
        self.steps.append(step)
        self.on_step(step)

    def _end(self, robot: str, event: on.Finish) -> None:
        step = self._by_key.get((robot, event.key))
        if step is not None and math.isnan(step.ended):
            step.ended = self._now()
            step.error = "" if isinstance(event.reply, Returned) else event.reply.error
