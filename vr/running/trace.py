"""Where an error arose, as text for the log, written in the thread of an author's code."""

from __future__ import annotations

import traceback


def trace(error: BaseException) -> str:
    """Write an error with its stack, without the marks below columns.

    To place these marks Python parses the source. CPython before 3.11.8 and 3.12.1 counts the depth of all
    parsers in one place (github.com/python/cpython/issues/106905): of two threads that parse at once one is
    told "AST constructor recursion depth mismatch", and that may be one that has nothing to do with robots.
    """
    told = traceback.TracebackException.from_exception(error)
    todo = [told]
    while todo:
        one = todo.pop()
        for frame in one.stack:
            frame.colno = None
        todo += [other for other in (one.__cause__, one.__context__, *(one.exceptions or ())) if other]
    return "".join(told.format())


def words_of(error: BaseException) -> str:
    """Return kind and text of an error; one whose text cannot be written is told by its kind alone."""
    kind = type(error).__name__
    try:
        text = str(error)
    except Exception:  # noqa: BLE001 # the author's own __str__
        return kind
    return f"{kind}: {text}" if text else kind
