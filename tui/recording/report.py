"""A recording as Markdown: who was there, what was asked and how it ended, what was read, pictures."""

from __future__ import annotations

import re
import time
from pathlib import Path

from robotree.files import overwrite
from robotree.tui.recording import summary
from robotree.tui.recording.tape import RecordedPicture, Tape
from robotree.vr.base import readable

PICTURES = 12
"""Pictures of each camera at most, evenly spread over the time, and one at each end of a command."""


def write(tape: Tape, out: Path) -> tuple[Path, int]:
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
    robots = summary.robots_of(tape)
    lines += [f"| {_cell(robot.name)} | {_cell(robot.kind)} | {robot.states} |" for robot in robots]
    lines += ["", "## Readings", "", "| reading | least | largest | unit |", "|---|--:|--:|---|"]
    for robot in robots:
        for key, (low, high) in sorted(robot.peaks.items()):
            unit = robot.units.get(key, "")
            name = _cell(f"{robot.name}.{key}")
            lines.append(f"| {name} | {readable.number(low)} | {readable.number(high)} | {_cell(unit)} |")
    lines += ["", "## What happened", "", "| s | robot | | |", "|--:|---|---|---|"]
    for name, line in summary.lines_of(tape):
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
