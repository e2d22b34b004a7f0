"""Files that only their owner can read and that several programs change: read, lock, replace atomically."""

from __future__ import annotations

import fcntl
import os
import stat
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NamedTuple

from robotree.files import opened, own, sync_folder
from robotree.protocol.errors import KeyFileError
from robotree.protocol.signing import KEY_BYTES, Key

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

LARGEST = 1_000_000
"""[bytes] of a key file: ten thousand keys."""
_LOOK = 0.002
"""[s] between two attempts to lock a file."""


class State(NamedTuple):
    """Tells whether a file is still the one that was read."""

    device: int
    inode: int
    size: int
    changed: int
    """[ns]"""


class Content(NamedTuple):
    """A file that was read."""

    text: str
    state: State


class Line(NamedTuple):
    """A line with a key."""

    number: int
    """From 0."""
    pattern: str
    key: Key


def key_lines(path: Path, text: str) -> list[Line]:
    """The lines with keys.

    Raises:
        KeyFileError: one makes no sense; it is named by its number.
    """
    stripped = [line.strip() for line in text.splitlines()]
    return [_line(path, i, line) for i, line in enumerate(stripped) if line and not line.startswith("#")]


def with_key(path: Path, text: str, controller: str, secret: bytes) -> str:
    """The text of a whole file with another key for one controller, and everything else as it was.

    Raises:
        KeyFileError: a line makes no sense.
    """
    lines = text.splitlines(keepends=True)
    line = next((each for each in key_lines(path, text) if each.pattern == controller), None)
    if line is None:  # before all others: the first pattern that matches decides
        return f"{controller} {secret.hex()}\n{text}"
    before, pattern, after = lines[line.number].partition(line.pattern)
    lines[line.number] = before + pattern + after.replace(after.strip(), secret.hex())
    return "".join(lines)


def _line(path: Path, number: int, line: str) -> Line:
    pattern, _, digits = line.partition(" ")
    try:
        return Line(number, pattern, Key(bytes.fromhex(digits)))
    except ValueError:  # its text would show the key
        problem = f"line {number + 1} is no pattern and key of {2 * KEY_BYTES} digits"
        raise KeyFileError(path, problem) from None


def read(path: Path) -> Content:
    """Read a file that nobody else may.

    Raises:
        KeyFileError: others can, or nobody.
    """
    try:
        # What is no UTF-8 in a comment, and how lines end, must come back when the file is written again.
        with os.fdopen(
            opened(path, os.O_RDONLY | own(path)), encoding="utf-8", errors="surrogateescape", newline=""
        ) as file:
            status = os.fstat(file.fileno())
            if stat.S_IMODE(status.st_mode) & 0o077:
                raise KeyFileError(path, "others can read it; run chmod 600 on it and change the keys")
            if status.st_uid != os.geteuid():
                raise KeyFileError(path, "it belongs to somebody else; make one of your own")
            if status.st_size > LARGEST:
                raise KeyFileError(path, f"it is larger than {LARGEST // 1000} kB; this is no key file")
            return Content(file.read(LARGEST), _state(status))
    except OSError as error:
        raise KeyFileError(path, f"cannot be read: {error.strerror}") from error


def _state(status: os.stat_result) -> State:
    return State(status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


def state_of(path: Path) -> State:
    """How a file is now.

    Raises:
        KeyFileError: there is none, or it cannot be reached.
    """
    try:
        return _state(path.stat())
    except OSError as error:
        raise KeyFileError(path, f"cannot be read: {error.strerror}") from error


@contextmanager
def alone(path: Path, patience: float) -> Generator[None]:
    """Let no other program change a file, or what lies beside it, inside the block.

    Args:
        path: of the file.
        patience: [s] to wait for other programs, which may be stopped while they hold the lock.

    Yields:
        Nothing.

    Raises:
        OSError: it cannot be opened.
        KeyFileError: the others take longer.
    """
    ends = time.monotonic() + patience
    while True:
        with os.fdopen(opened(path), "rb") as ours:
            if not _lock(ours.fileno(), ends):  # released when the file is closed, or we are killed
                problem = f"another program has held it for {patience:g} s; let that go on, or end it"
                raise KeyFileError(path, f"{problem} (fuser {path} names it)")
            if os.path.samestat(os.fstat(ours.fileno()), path.stat()):
                yield
                return
        # While we waited the file was replaced by another one, which others may have locked.


def _lock(descriptor: int, ends: float) -> bool:
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > ends:
                return False
            time.sleep(_LOOK)  # flock waits for ever or not at all; the caller is in a thread
        else:
            return True


def replace(path: Path, text: str) -> None:
    """Replace a file at once and for good: who reads it, also after a power cut, finds one or the other.

    Raises:
        OSError: it cannot be written.
    """
    draft = path.with_name(f"{path.name}.new")
    draft.unlink(missing_ok=True)  # of a program that was killed
    try:
        write(draft, text)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    with suppress(OSError):  # some file systems cannot; the new file is in its place all the same
        sync_folder(path.parent)


def write(path: Path, text: str) -> None:
    """Write a new file that nobody else can read, for good.

    Raises:
        OSError: it cannot be written, or there is something of this name.
    """
    descriptor = opened(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
    with os.fdopen(descriptor, "w", encoding="utf-8", errors="surrogateescape", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
