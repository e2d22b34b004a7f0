"""The way of an error through the pages of authors: their lines alone, without those of this project.

team.fetch
  team.py, line 12, in fetch: self.arm.go_to(x=self.place(3))
  team.py, line 20, in place: raise Failed("no such place") from error
because of KeyError: 3
  team.py, line 18, in place: return PLACES[number]
"""

from __future__ import annotations

import linecache
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from robotree.vr.errors import VrError
from robotree.vr.running.naming import authors_file
from robotree.vr.running.trace import words_of

MOST_LINES = 60
"""Lines of a trace: a recursion without end must not fill a message."""
MOST_CAUSES = 8
LONGEST_LINE = 160
"""Characters of a line of a page."""


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


def page_lines(error: BaseException, source: str) -> list[PageLine]:
    """Return the lines of a page through which an error came, the outermost first.

    Args:
        error: as it was caught.
        source: file of the robot's class, as tracebacks call it.
    """
    found: list[PageLine] = []
    step = error.__traceback__
    while step is not None:
        if _of_page(step.tb_frame, source):
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
        if _of_page(frame, source):
            return _line(frame, frame.f_lineno)
        frame = frame.f_back
    return None


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


def _of_page(frame: FrameType, source: str) -> bool:
    file = frame.f_code.co_filename
    return file == source or authors_file(file) != file


def _line(frame: FrameType, number: int) -> PageLine:
    file = frame.f_code.co_filename
    text = linecache.getline(file, number).strip()
    return PageLine(authors_file(file), number, frame.f_code.co_name, text)
