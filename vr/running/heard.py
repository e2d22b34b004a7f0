"""The output of robots' code: `print`, warnings and `logging` go to the log of the robot that runs them.

A host is one process with one standard output and many robots. Whose line it is follows from the context in
which it is written: that of a running command (`context.activity_here`), also in a thread that the command
was handed on to, or that of a hook or a constructor (`speaking`). All else goes where it went before.
"""

from __future__ import annotations

import contextlib
import io
import logging
import sys
import warnings
from collections.abc import Generator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Literal, Protocol, TextIO

from robotree.files import forks
from robotree.vr.author.context import activity_here
from robotree.vr.base.requests import Level
from robotree.vr.running.page_trace import authors_file


class Voice(Protocol):
    """Takes output of a robot's code."""

    def __call__(self, level: Level, text: str, *, piece: bool = False) -> None:
        """Take one text, or a piece of one that ends with a line break when its line does."""
        ...


_voice: ContextVar[Voice | None] = ContextVar("robotree_voice", default=None)


# -- who speaks ------------------------------------------------------------------------------------


@contextlib.contextmanager
def speaking(voice: Voice) -> Generator[None]:
    """Send all output in the block to the log of one robot."""
    token = _voice.set(voice)
    try:
        yield
    finally:
        _voice.reset(token)


def voice_here() -> Voice | None:
    """Return what takes the output of the code that runs here; None: nothing does."""
    if forks.is_child:
        return None
    activity = activity_here()
    return _voice.get() if activity is None else activity.say


class _Stream(io.TextIOBase):
    """A standard stream that hands on the output of robots' code."""

    def __init__(self, stream: TextIO, level: Level) -> None:
        super().__init__()
        self._stream = stream
        self._level: Level = level

    def write(self, text: str) -> int:
        """Write, and let the robot's log have it."""
        voice = voice_here()
        if voice is not None:
            voice(self._level, text, piece=True)
        return self._stream.write(text)

    def flush(self) -> None:
        """Flush."""
        self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class _Handler(logging.Handler):
    """Hands on what robots log."""

    def emit(self, record: logging.LogRecord) -> None:
        """Let the robot's log have a record; others go where they go without any handler."""
        voice = voice_here()
        if voice is not None:
            voice(_level(record.levelno), self.format(record))
        elif logging.lastResort is not None and record.levelno >= logging.lastResort.level:
            logging.lastResort.handle(record)


class _NoInput(io.TextIOBase):
    """Standard input of pages: there is none, for that of the process is its starter's or a person's."""

    def readable(self) -> bool:
        return True

    def read(self, _size: int | None = -1, /) -> str:
        """Refuse.

        Raises:
            OSError: always.
        """
        raise OSError("a page cannot read from the keyboard: make its question a parameter of the command")

    def readline(self, size: int = -1, /) -> str:  # type: ignore[override] # the stubs have two other forms
        """Refuse, as `read`."""
        return self.read(size)


def _level(number: int) -> Literal["debug", "info", "warning", "error"]:
    if number >= logging.ERROR:
        return "error"
    if number >= logging.WARNING:
        return "warning"
    return "info" if number >= logging.INFO else "debug"


def _no_debugger(*values: Any, **named: Any) -> None:
    """Refuse `breakpoint()` in a page, which would wait for a keyboard; elsewhere do what Python does.

    Raises:
        OSError: the code of a robot calls it.
    """
    if voice_here() is None:
        sys.__breakpointhook__(*values, **named)  # noqa: T100 # it is not a page that calls it
        return
    raise OSError("a host has no keyboard for breakpoint(): take it away, or run the page in a rehearsal")


@contextlib.contextmanager
def listening() -> Generator[None]:
    """Collect the output of robots in this process, and let them read no input: for the process of a host."""
    before, typed = (sys.stdout, sys.stderr, warnings.showwarning), sys.stdin
    root, handler = logging.getLogger(), _Handler(logging.NOTSET)
    level = root.level
    for other in root.handlers:
        other.setLevel(max(other.level, level))  # it gets no more than before
    sys.stdout, sys.stderr = _Stream(sys.stdout, "info"), _Stream(sys.stderr, "warning")
    sys.stdin, sys.breakpointhook = _NoInput(), _no_debugger
    root.addHandler(handler)
    root.setLevel(logging.INFO)

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        voice = voice_here()
        if voice is None:
            before[2](message, category, filename, lineno, file, line)
        else:
            page = Path(authors_file(filename)).name
            voice("warning", f"{category.__name__}: {message} ({page}, line {lineno})")

    warnings.showwarning = show
    try:
        yield
    finally:
        sys.stdout, sys.stderr, warnings.showwarning = before
        sys.stdin, sys.breakpointhook = typed, sys.__breakpointhook__
        root.removeHandler(handler)
        root.setLevel(level)
