"""What a recording holds, for people: as text, and as a report in Markdown with pictures."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robotree.files import overwrite
from robotree.tui.recording.tape import RecordedLine, RecordedPicture, RecordedState, Tape
from robotree.tui.seen import status, wording
from robotree.vr.base import readable
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


# -- as Markdown -----------------------------------------------------------------------------------

PICTURES = 12
"""Pictures of each camera at most, evenly spread over the time, and one at each end of a command."""


def write_report(tape: Tape, out: Path) -> tuple[Path, int]:
    """Write `out` and, beside it, the folder `NAME-pictures`; returns that folder and how many it holds.

    Raises:
        OSError: it cannot be written.
    """
    folder = out.with_name(f"{out.stem}-pictures")
    chosen = pictures_of(tape)
    if chosen:
        folder.mkdir(exist_ok=True)
    rows = list[str]()
    for number, (unix, picture) in enumerate(chosen, 1):
        name = f"{number:03}-{_plain(picture.view)}-{_plain(picture.camera)}.jpg"
        overwrite(folder / name, picture.jpeg)
        where = f"{unix - tape.began:.1f} s, {_cell(picture.view)}, camera {_cell(picture.camera)}"
        rows.append(f"{where}\n\n![]({folder.name}/{name})\n")
    overwrite(out, "\n".join([head(tape), *rows]).encode())
    return folder, len(chosen)


def pictures_of(tape: Tape) -> list[tuple[float, RecordedPicture]]:
    """Return the pictures that a report shows: of each camera some, evenly spread over the time."""
    cameras = dict[tuple[str, str], list[tuple[float, RecordedPicture]]]()
    for unix, picture in tape.all_of(RecordedPicture):
        cameras.setdefault((picture.view, picture.camera), []).append((unix, picture))
    chosen = list[tuple[float, RecordedPicture]]()
    for taken in cameras.values():
        count = min(PICTURES, len(taken))
        positions = {round(index * (len(taken) - 1) / max(count - 1, 1)) for index in range(count)}
        chosen += [taken[position] for position in sorted(positions)]
    return sorted(chosen, key=lambda each: each[0])


def head(tape: Tape) -> str:
    """Return all that stands above the pictures."""
    day = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(tape.began))
    lines = [
        f"# Realm {_cell(tape.about.get('realm') or 'default')}, {day}",
        "",
        f"{tape.ended - tape.began:.1f} s; from the recording `{tape.name}`."
        + ("" if tape.whole else f" The recording: {tape.end_in_words}."),
        "",
        "## Robots",
        "",
        "| robot | kind | states |",
        "|---|---|--:|",
    ]
    robots = robots_of(tape)
    lines += [f"| {_cell(robot.name)} | {_cell(robot.kind)} | {robot.states} |" for robot in robots]
    lines += ["", "## Readings", "", "| reading | least | largest | unit |", "|---|--:|--:|---|"]
    for robot in robots:
        for key, (low, high) in sorted(robot.peaks.items()):
            unit = robot.units.get(key, "")
            name = _cell(f"{robot.name}.{key}")
            lines.append(f"| {name} | {readable.number(low)} | {readable.number(high)} | {_cell(unit)} |")
    lines += ["", "## What happened", "", "| s | robot | | |", "|--:|---|---|---|"]
    for name, line in lines_of(tape):
        lines.append(f"| {line.unix - tape.began:.1f} | {_cell(name)} | {line.level} | {_cell(line.text)} |")
    return "\n".join([*lines, "", "## Pictures", ""])


def _plain(text: str) -> str:
    """Return a text as part of a file's name."""
    return re.sub(r"[^\w-]", "-", text, flags=re.ASCII)[:40]


def _cell(text: str) -> str:
    """Return a text as one cell of a table: it comes from afar, and must not be markup."""
    plain = " ".join(text.split())
    for sign in "\\|<>[]*_`":
        plain = plain.replace(sign, f"\\{sign}")
    return plain
