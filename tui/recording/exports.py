"""The verbs that read a recording: `recording`, and `export`, which writes a file of another format."""

from __future__ import annotations

import fcntl
import os
from errno import EEXIST
from pathlib import Path
from typing import BinaryIO

from robotree.files import overwrite
from robotree.tui import exit_codes
from robotree.tui.errors import BadRecordedRealm, ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.recording import comparing, replayed, summary, tape
from robotree.tui.terminal import answer

LARGEST = 4_000_000_000
"""[bytes] of a recording that is read: it is kept in memory as a whole."""


def recording(line: Line, _realm: str) -> int:
    """Print what a recording holds, or how everything was at a moment."""
    found, moment = opened(line.text("FILE")), line.text("--at")
    if moment:
        text = summary.at(found, within(found, moment))
        answer(text, lambda: {"at": moment, "text": text})
    else:
        answer(summary.text(found), lambda: summary.data(found))
    return exit_codes.DONE


def compare(line: Line, _realm: str) -> int:
    """Print where two recordings differ."""
    first, second = opened(line.text("FILE")), opened(line.text("OTHER"))
    answer(comparing.text(first, second), lambda: comparing.data(first, second))
    return exit_codes.DONE


def session(line: Line, _realm: str) -> int:
    """Write what persons asked for as a session script, or print it."""
    text = replayed.session_of(opened(line.text("FILE")), _is_mine)
    if out := line.text("OUT"):
        overwrite(_new(Path(out)), text.encode())
        answer(f"{out}: the session", lambda: {"file": out})
    else:
        answer(text.rstrip("\n"), lambda: {"session": text})
    return exit_codes.DONE


def lerobot(line: Line, _realm: str) -> int:
    """Write a recording as a LeRobot data set."""
    from robotree.tui.recording.lerobot import fps_of, write

    found = opened(line.text("FILE"))
    folder = _new(Path(line.text("OUT") or Path(found.name).with_suffix("").name))
    counts = write(found, folder, fps_of(line.text("--fps")))
    text = f"{folder}: {counts['episodes']} episodes, {counts['frames']} frames, {counts['tasks']} tasks"
    answer(text, lambda: {"folder": str(folder), **counts})
    return exit_codes.DONE


def report_of(line: Line, _realm: str) -> int:
    """Write a recording as Markdown with pictures."""
    found = opened(line.text("FILE"))
    out = _new(Path(line.text("OUT") or Path(found.name).with_suffix(".md").name))
    folder, count = summary.write_report(found, out)
    text = f"{out}, and {count} pictures in {folder}" if count else str(out)
    answer(text, lambda: {"file": str(out), "pictures": count})
    return exit_codes.DONE


def opened(name: str) -> tape.Tape:
    """Read the recording of a file.

    Raises:
        BadRecordedRealm: it cannot be read.
    """
    path = Path(name)
    try:
        if not path.is_file():
            raise BadRecordedRealm(name, "is no file" if path.exists() else "does not exist")
        if path.stat().st_size > LARGEST:
            raise BadRecordedRealm(name, f"is larger than {LARGEST / 1e9:.0f} GB, which is not read at once")
        with path.open("rb") as file:
            return tape.read(file, name, growing=_is_written(file))
    except OSError as error:
        raise BadRecordedRealm(name, f"cannot be read: {error.strerror}") from None


def _is_written(file: BinaryIO) -> bool:
    """Whether a recorder writes into a file now: it keeps a lock on it, which the kernel ends with it."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    fcntl.flock(file, fcntl.LOCK_UN)
    return False


def _is_mine(page: str) -> bool:
    """Whether a page, `FILE` or `FILE:Class`, is a file of this user."""
    path, _ = values.source(page)
    try:
        return Path(path).stat().st_uid == os.geteuid()
    except OSError:
        return False


def within(found: tape.Tape, moment: str) -> float:
    """Return a moment [s] after the beginning of a recording.

    Raises:
        ValueRefused: it is no duration, or the recording ended before.
    """
    seconds, length = values.duration(moment), found.ended - found.began
    if seconds > length:
        raise ValueRefused("TIME", f"{found.name} is only {length:.1f} s long; write a shorter time")
    return seconds


def _new(path: Path) -> Path:
    """Return a path at which nothing is yet: a person may have changed what was exported before.

    Raises:
        FileExistsError: something is there.
    """
    if path.exists():
        raise FileExistsError(EEXIST, "it exists already, and nothing is overwritten", str(path))
    return path
