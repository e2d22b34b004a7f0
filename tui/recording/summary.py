"""What a recording holds, for people: its robots, and what was asked of them and how that ended."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from robotree.tui.recording.tape import RecordedLine, RecordedPicture, RecordedState, Tape
from robotree.tui.seen import status, wording
from robotree.vr.base.readable import quantity
from robotree.vr.base.requests import LoggedLine


class RecordedRobot(NamedTuple):
    """One robot of a recording."""

    name: str
    kind: str
    states: int
    peaks: dict[str, tuple[float, float]]
    """The least and the largest value of each reading, in its unit."""
    units: dict[str, str]


def robots_of(tape: Tape) -> Sequence[RecordedRobot]:
    """Return the robots of a recording, by name."""
    described, peaks = tape.described(), tape.peaks()
    states = Counter(state.name for _, state in tape.all_of(RecordedState))
    return [
        RecordedRobot(
            name,
            described[name].kind if name in described else "",
            states[name],
            peaks.get(name, {}),
            dict(described[name].units) if name in described else {},
        )
        for name in sorted({*described, *states})
    ]


def lines_of(tape: Tape) -> Sequence[tuple[str, LoggedLine]]:
    """Return the lines of all logs, the oldest first."""
    return [(name, line) for _, (name, line) in tape.all_of(RecordedLine)]


def text(tape: Tape) -> str:
    """Return what is in it, and its log."""
    cameras = Counter(f"{picture.view}/{picture.camera}" for _, picture in tape.all_of(RecordedPicture))
    day = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(tape.began))
    length = f"{tape.ended - tape.began:.1f} s from {day}"
    ends = f"; {tape.end_in_words}" if tape.end_in_words else ""
    rows = [
        (robot.name, robot.kind, f"{robot.states} states", _peaks(robot)) for robot in robots_of(tape)
    ] + [(name, "camera", f"{count} pictures", "") for name, count in sorted(cameras.items())]
    log = [wording.log_line(line, name) for name, line in lines_of(tape)]
    head = f"realm {tape.about.get('realm') or 'default'}, {length}{ends}"
    return "\n".join([head, wording.columns(rows), *log])


def data(tape: Tape) -> dict[str, Any]:
    """Return the same as plain data."""
    return {
        "realm": tape.about.get("realm", ""),
        "began": tape.began,
        "seconds": round(tape.ended - tape.began, 3),
        "whole": tape.whole,
        "growing": tape.growing,
        "robots": [robot._asdict() for robot in robots_of(tape)],
        "pictures": sum(1 for _ in tape.all_of(RecordedPicture)),
        "lines": len(lines_of(tape)),
    }


def at(tape: Tape, seconds: float) -> str:
    """Return how each robot was, some seconds after the beginning."""
    latest = dict[str, RecordedState]()
    for unix, recorded in tape.all_of(RecordedState):
        if unix <= tape.began + seconds:
            latest[recorded.name] = recorded
    units = {robot.name: robot.units for robot in robots_of(tape)}
    rows = list[tuple[str, str, str]]()
    for name, (_, state) in sorted(latest.items()):
        readings = (_reading(key, value, units[name]) for key, value in sorted(state.readings.items()))
        rows.append((name, status.words(state), "  ".join(readings)))
    return wording.columns(rows)


def _reading(key: str, value: float, units: dict[str, str]) -> str:
    return f"{key}={quantity(value, units.get(key, ''))}"


def _peaks(robot: RecordedRobot) -> str:
    return "  ".join(
        f"{key} {quantity(low, '')} … {quantity(high, robot.units.get(key, ''))}"
        for key, (low, high) in sorted(robot.peaks.items())
        if low != high
    )
