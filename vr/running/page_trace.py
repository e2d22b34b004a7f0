"""Where an error arose in an author's code, as text: for callers the lines of pages alone, for the log all.

In tracebacks the text of a bundle is called `PATH@VERSION`, so that no two versions are mixed up. A trace of
pages has none of this project's lines:

team.fetch
  team.py, line 12, in fetch: self.arm.go_to(x=self.place(3))
  team.py, line 20, in place: raise Failed("no such place") from error
because of KeyError: 3
  team.py, line 18, in place: return PLACES[number]
"""

from __future__ import annotations

import inspect
import linecache
import re
import traceback
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from robotree.vr.base.errors import VrError, words_of

MOST_LINES = 60
"""Lines of a trace: a recursion without end must not fill a message."""
MOST_CAUSES = 8
LONGEST_LINE = 160
"""Characters of a line of a page."""
NEAR = 12
"""Frames between the line of a page and the call of a child that it makes, at most."""
_VERSION = re.compile(r"@[0-9a-f]{8}\Z")


def file_in_tracebacks(path: str, digest: str) -> str:
    """Return what a source is called: the same only for the same text at the same place.

    Args:
        path: where its author keeps it.
        digest: hash of the source, in hex.
    """
    return f"{path}@{digest[:8]}"


def authors_file(file: str) -> str:
    """Return the path that an author knows, of a file as tracebacks call it."""
    return _VERSION.sub("", file)


def trace(error: BaseException) -> str:
    """Write an error with its stack, without the marks below columns.

    To place these marks Python parses the source. CPython before 3.11.8 and 3.12.1 counts the depth of all
    parsers in one place (github.com/python/cpython/issues/106905): of two threads that parse at once one is
    told "AST constructor recursion depth mismatch", and that may be one that has nothing to do with robots.
    """
    trace = traceback.TracebackException.from_exception(error)
    todo = [trace]
    while todo:
        one = todo.pop()
        for frame in one.stack:
            frame.colno = None
        todo += [other for other in (one.__cause__, one.__context__, *(one.exceptions or ())) if other]
    return "".join(trace.format())


class PageLine(NamedTuple):
    """A line of a page at work."""

    file: str
    """Path, as its author knows it."""
    line: int
    function: str
    text: str

    @property
    def place(self) -> str:
        """Where it is, in words: `team.py, line 12`."""
        return f"{Path(self.file).name}, line {self.line}"

    def __str__(self) -> str:
        return f"  {self.place}, in {self.function}: {self.text}"[:LONGEST_LINE].rstrip(": ")


def begin_of(function: Callable[..., object]) -> str:
    """Return where a function of a page begins, its decorators included: `team.py, line 12`."""
    code = inspect.unwrap(function).__code__
    return f"{Path(authors_file(code.co_filename)).name}, line {code.co_firstlineno}"


def page_lines(error: BaseException, source: str) -> list[PageLine]:
    """Return the lines of a page through which an error came, the outermost first.

    Args:
        error: as it was caught.
        source: file of the robot's class, as tracebacks call it.
    """
    found: list[PageLine] = []
    step = error.__traceback__
    while step is not None:
        if is_of_page(step.tb_frame, source):
            found.append(_line(step.tb_frame, step.tb_lineno))
        step = step.tb_next
    return found


def line_at_work(frame: FrameType | None, source: str) -> PageLine | None:
    """Return the innermost line of a page that a thread is in; None: it is in none.

    Args:
        frame: the innermost one of the thread (`sys._current_frames`).
        source: file of the robot's class, as tracebacks call it.
    """
    while frame is not None:
        if is_of_page(frame, source):
            return _line(frame, frame.f_lineno)
        frame = frame.f_back
    return None


def page_line(frame: FrameType | None) -> int:
    """Return the number of the innermost line of a page that a thread is in; 0: none of the near ones is.

    Args:
        frame: the innermost one of the thread.
    """
    for _ in range(NEAR):
        if frame is None:
            break
        file = frame.f_code.co_filename
        if file[-9:-8] == "@" and authors_file(file) != file:
            return frame.f_lineno
        frame = frame.f_back
    return 0


def trace_of(label: str, error: BaseException, source: str) -> tuple[str, ...]:
    """Return the trace of an error that ended a command, and of what caused it.

    Args:
        label: `robot.command`.
        error: as it was caught.
        source: see `page_lines`.
    """
    lines = [label, *_lines(error, source)]
    seen = {id(error)}
    for _ in range(MOST_CAUSES):
        asked, hidden = error.__cause__, error.__suppress_context__
        cause = asked or (None if hidden else error.__context__)
        if cause is None or id(cause) in seen:
            break
        below = _lines(cause, source)
        said = f"{cause}" if isinstance(cause, VrError) else words_of(cause)
        if below or asked is not None:
            lines += [f"{'because of' if asked is not None else 'while handling'} {said}", *below]
        seen.add(id(cause))
        error = cause
    if len(lines) > MOST_LINES:
        lines[MOST_LINES // 2 : -MOST_LINES // 2] = ["  …"]
    return tuple(lines)


def _lines(error: BaseException, source: str) -> list[str]:
    below = error.trace if isinstance(error, VrError) else ()
    return [*map(str, page_lines(error, source)), *below]


def is_of_page(frame: FrameType, source: str) -> bool:
    """Whether a function at work is of a page.

    Args:
        frame: of the function.
        source: file of the robot's class, as tracebacks call it.
    """
    file = frame.f_code.co_filename
    return file == source or authors_file(file) != file


def _line(frame: FrameType, number: int) -> PageLine:
    file = frame.f_code.co_filename
    text = linecache.getline(file, number).strip()
    return PageLine(authors_file(file), number, frame.f_code.co_name, text)
