"""The results of the trials, as a table in Markdown."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the table: what is tried, and which time is measured."""

    kind: str
    what: str
    measured: str
    """From when to when."""
    bar: float | None = None
    """[s] The longest time allowed; None: there is no limit."""


@dataclass(slots=True)
class Trial:
    """The result of one trial, for one row."""

    row: Row
    reached: bool
    seconds: float | None = None
    """[s]; None: nothing is measured."""
    false: list[str] = field(default_factory=list[str])
    """What robotree reported and was not true."""
    note: str = ""
    """Why it was not reached."""
    number: str = ""
    """Name of the trial, for `--only`."""
    skipped: str = ""
    """Why it could not be tried here."""


def table(trials: Iterable[Trial]) -> str:
    """Write the table in Markdown; below it each trial that failed."""
    rows: dict[Row, list[Trial]] = {}
    skipped = list[Trial]()
    for trial in trials:
        if trial.skipped:
            skipped.append(trial)
        else:
            rows.setdefault(trial.row, []).append(trial)
    lines = [
        "| | trials | reached | p50 [s] | max [s] | bar [s] | false | time from … to |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row, found in rows.items():
        seconds = [one.seconds for one in found if one.reached and one.seconds is not None]
        middle, most = (f"{statistics.median(seconds):.2f}", f"{max(seconds):.2f}") if seconds else ("", "")
        bar = "" if row.bar is None else f"{row.bar:g}"
        reached = sum(one.reached for one in found)
        false = sum(len(one.false) for one in found)
        cells = (f"{row.kind}: {row.what}", len(found), reached, middle, most, bar, false, row.measured)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    bad = [one for found in rows.values() for one in found if _is_bad(one)]
    lines += ["", *(f"* {_told(one)}" for one in bad)] if bad else ["", "Every trial passed."]
    lines += [f"* {one.number} ({one.row.kind}: {one.row.what}): not tried: {one.skipped}" for one in skipped]
    return "\n".join(lines)


def is_good(trials: Iterable[Trial]) -> bool:
    """Whether every trial passed."""
    return not any(_is_bad(trial) for trial in trials)


def _is_bad(one: Trial) -> bool:
    if one.skipped:
        return False
    late = one.row.bar is not None and one.seconds is not None and one.seconds > one.row.bar
    return not one.reached or late or bool(one.false)


def _told(one: Trial) -> str:
    what = [*([one.note] if one.note else []), *(f"false: {each}" for each in one.false)]
    if one.seconds is not None and one.row.bar is not None and one.seconds > one.row.bar:
        what.append(f"{one.seconds:.2f} s instead of {one.row.bar:g}")
    return f"{one.number} ({one.row.kind}: {one.row.what}): {'; '.join(what) or 'not reached'}"
