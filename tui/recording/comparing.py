"""Two recordings beside each other: the same commands, and where they differ. No clock is read here.

Commands are aligned by robot, name and arguments, in the order in which they were asked. Of a command that is
in both, how it ended, how long it took, and the readings of its robot when it ended are compared.
"""

from __future__ import annotations

import difflib
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from robotree.tui.recording.tape import RecordedLine, RecordedState, Tape
from robotree.tui.seen import wording
from robotree.tui.seen.cells import seen
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.principal import is_person
from robotree.vr.base.readable import quantity

NEAR = 0.02
"""Readings that differ by less than this share of their range in both recordings count as equal."""

SLOWER = 0.1
"""[s] Durations that differ by less count as equal; so do those within a tenth of each other."""

ENDS = {"done": "done", "failed": "failed", "cancelled": "cancelled"}


class Ran(NamedTuple):
    """One command of a recording."""

    robot: str
    words: str
    """`arm-1.go_to x=0.3`."""
    began: float
    """[s] since the recording began."""
    ended: float | None
    """[s]; None: it went on when the recording ended."""
    result: str
    """`done`, or the name of the error."""
    readings: Mapping[str, float]
    """Of its robot when it ended, in SI units."""
    units: Mapping[str, str]

    @property
    def took(self) -> float | None:
        """[s]."""
        return None if self.ended is None else self.ended - self.began


class Pair(NamedTuple):
    """A command of both recordings, or of one."""

    first: Ran | None
    second: Ran | None
    differs: tuple[str, ...]
    """What is another one in the second, in words; empty: nothing."""


def ran(tape: Tape, *, persons: bool = False) -> list[Ran]:
    """Return the commands of a recording, or those of persons alone, in the order of their beginnings."""
    begun, ended = dict[tuple[str, str], tuple[float, str]](), dict[tuple[str, str], tuple[float, str]]()
    for unix, content in tape.entries:
        match content:
            case RecordedLine(robot, line) if line.level == "asked" and (
                is_person(line.caller) or not persons
            ):
                words = f"{robot}.{line.command} {line.arguments}".rstrip()
                begun.setdefault((robot, line.key), (unix, words))
            case RecordedLine(robot, line) if line.level in ENDS:
                ended.setdefault((robot, line.key), (unix, ENDS[line.level]))
            case HistoryEvent(kind="ended") if content.error:
                ended[content.robot, content.key] = (
                    ended.get((content.robot, content.key), (unix, ""))[0],
                    content.error,
                )
            case _:
                pass
    moments = _moments(tape)
    robots = tape.described()
    found = list[Ran]()
    for (robot, key), (unix, words) in begun.items():
        end, result = ended.get((robot, key), (None, "went on"))
        readings = _at(moments.get(robot, ([], [])), tape.ended if end is None else end)
        since = None if end is None else end - tape.began
        units = robots[robot].units if robot in robots else {}
        found.append(Ran(robot, words, unix - tape.began, since, result, readings, units))
    return sorted(found, key=lambda each: each.began)


Moments = tuple[list[float], list[Mapping[str, float]]]


def _moments(tape: Tape) -> Mapping[str, Moments]:
    """Return the readings of each robot with their times."""
    found = dict[str, Moments]()
    for unix, (name, state) in tape.all_of(RecordedState):
        times, readings = found.setdefault(name, ([], []))
        times.append(unix)
        readings.append(state.readings)
    return found


def _at(moments: Moments, unix: float) -> Mapping[str, float]:
    times, readings = moments
    position = bisect_right(times, unix)
    return readings[position - 1] if position else {}


def ranges(*tapes: Tape) -> Mapping[tuple[str, str], float]:
    """Return how far each reading of each robot went in all recordings together."""
    found = dict[tuple[str, str], tuple[float, float]]()
    for tape in tapes:
        for robot, readings in tape.peaks().items():
            for name, (low, high) in readings.items():
                least, most = found.get((robot, name), (low, high))
                found[robot, name] = min(least, low), max(most, high)
    return {at: most - least for at, (least, most) in found.items()}


def compared(first: Tape, second: Tape) -> list[Pair]:
    """Return the commands of both recordings beside each other."""
    ones, others = ran(first), ran(second)
    spans = ranges(first, second)
    matcher = difflib.SequenceMatcher(
        None, [each.words for each in ones], [each.words for each in others], autojunk=False
    )
    pairs = list[Pair]()
    for _, begin, end, from_, to in matcher.get_opcodes():
        pairs += _aligned(ones[begin:end], others[from_:to], spans)
    return pairs


def _aligned(
    ones: Sequence[Ran], others: Sequence[Ran], spans: Mapping[tuple[str, str], float]
) -> Iterator[Pair]:
    if [each.words for each in ones] == [each.words for each in others]:
        for one, other in zip(ones, others, strict=True):
            yield Pair(one, other, tuple(_differences(one, other, spans)))
        return
    for one in ones:
        yield Pair(one, None, ("only in the first",))
    for other in others:
        yield Pair(None, other, ("only in the second",))


def _differences(one: Ran, other: Ran, spans: Mapping[tuple[str, str], float]) -> Iterator[str]:
    if one.result != other.result:
        yield f"{one.result} → {other.result}"
    if one.took is not None and other.took is not None:
        less, more = sorted((one.took, other.took))
        if more - less > max(SLOWER, less * 0.1):
            yield f"{one.took:.2f} s → {other.took:.2f} s"
    for name, said in _unequal(one.robot, one.readings, other.readings, one.units, spans):
        yield f"{name} {said}"


def _unequal(
    robot: str,
    ones: Mapping[str, float],
    others: Mapping[str, float],
    units: Mapping[str, str],
    spans: Mapping[tuple[str, str], float],
) -> Iterator[tuple[str, str]]:
    """Yield the readings of a robot that differ, by name: what they are in both."""
    for name in sorted({*ones} & {*others} - {"age", "progress"}):
        before, after = ones[name], others[name]
        if abs(after - before) > NEAR * spans.get((robot, name), 0.0):
            unit = units.get(name, "")
            one, other = quantity(before, unit), quantity(after, unit)
            if one != other:  # as a person reads them
                yield name, f"{one} → {other}"


def text(first: Tape, second: Tape) -> str:
    """Return the comparison, for people."""
    pairs = compared(first, second)
    rows = [*map(_row, pairs)]
    unequal = sum(bool(pair.differs) for pair in pairs)
    head = f"{first.name} → {second.name}: {len(pairs)} commands, {unequal} differ"
    lengths = f"{first.ended - first.began:.1f} s → {second.ended - second.began:.1f} s"
    return "\n".join([f"{head}; {lengths}", wording.columns(rows)])


def _row(pair: Pair) -> tuple[str, str, str]:
    words = seen((pair.first or pair.second or _NONE).words)
    return "≠" if pair.differs else "=", words, "; ".join(pair.differs)


_NONE = Ran("", "", 0.0, None, "", {}, {})


def data(first: Tape, second: Tape) -> dict[str, Any]:
    """Return the same as plain data."""
    pairs = compared(first, second)
    return {
        "first": first.name,
        "second": second.name,
        "differ": sum(bool(pair.differs) for pair in pairs),
        "commands": [
            {
                "words": (pair.first or pair.second or _NONE).words,
                "first": _plain(pair.first),
                "second": _plain(pair.second),
                "differs": list(pair.differs),
            }
            for pair in pairs
        ],
    }


def _plain(one: Ran | None) -> dict[str, Any] | None:
    if one is None:
        return None
    took = None if one.took is None else round(one.took, 3)
    return {"began": round(one.began, 3), "took": took, "result": one.result, "readings": dict(one.readings)}


class Beside:
    """Another recording, beside one that is replayed: what differs at a time after both beginnings."""

    def __init__(self, first: Tape, second: Tape) -> None:
        """Compare both; the first is replayed."""
        self.title = f"{first.name} → {second.name}"
        self._pairs = compared(first, second)
        self._ended = sorted(
            ((pair.first.ended or pair.first.began, pair) for pair in self._pairs if pair.first),
            key=lambda each: each[0],
        )
        self._times = [ended for ended, _ in self._ended]
        self._tapes = [(tape.began, _moments(tape)) for tape in (first, second)]
        self._lengths = [(seen(tape.name), tape.ended - tape.began) for tape in (first, second)]
        self._spans, self._robots = ranges(first, second), first.described()

    def words(self, seconds: float) -> str:
        """Return how the last command that had ended by then went in the other one, [s] after the beginning.

        It begins with `≠`, or `=`; empty: none had ended.
        """
        position = bisect_right(self._times, seconds)
        if not position:
            return ""
        pair = self._ended[position - 1][1]
        assert pair.first is not None  # noqa: S101 # chosen above
        sign, words, differs = _row(pair)
        return f"{sign} {words}: {differs or 'as in the other'}"

    def text(self, seconds: float) -> str:
        """Return the readings that differ so long [s] after both beginnings, and the commands of both.

        A `▸` in the first column stands for a command that goes on then in the first recording, in the second
        column in the second one.
        """
        (_, ones), (_, others) = self._tapes
        readings = [
            (seen(f"{robot}.{name}"), said)
            for robot in sorted({*ones} & {*others})
            for name, said in self._other_readings(robot, seconds)
        ]
        rows = [
            (f"{_mark(pair.first, seconds)}{_mark(pair.second, seconds)}", *row)
            for pair, row in zip(self._pairs, map(_row, self._pairs), strict=True)
        ]
        said = wording.columns(readings) if readings else "all readings are as in the other"
        return f"{self._moment(seconds)}\n\n{said}\n\n{wording.columns(rows)}"

    def _moment(self, seconds: float) -> str:
        """Say which moments are beside each other; behind its end a recording is as it was then."""
        over = [f"{name} is over after {length:.1f} s" for name, length in self._lengths if length < seconds]
        return "; ".join([f"{seconds:.1f} s after the beginning of both", *over])

    def _other_readings(self, robot: str, seconds: float) -> Iterator[tuple[str, str]]:
        ones, others = (_at(moments[robot], began + seconds) for began, moments in self._tapes)
        units = self._robots[robot].units if robot in self._robots else {}
        return _unequal(robot, ones, others, units, self._spans)


def _mark(one: Ran | None, seconds: float) -> str:
    goes_on = one is not None and one.began <= seconds and (one.ended is None or seconds < one.ended)
    return "▸" if goes_on else " "
