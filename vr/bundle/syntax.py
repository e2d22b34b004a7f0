"""Reads Python into a tree without running it: the one place where that is done."""

from __future__ import annotations

import ast
import gc
from collections.abc import Generator
from contextlib import contextmanager
from threading import Lock

_one_at_a_time = Lock()


def parse(source: str) -> ast.Module:
    """Return the tree of a page.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    with _uninterrupted():
        return ast.parse(source)


def parse_expression(source: str) -> ast.expr:
    """Return the tree of an expression.

    Raises:
        SyntaxError: it is none.
        ValueError: it has null bytes.
    """
    with _uninterrupted():
        return ast.parse(source, mode="eval").body


@contextmanager
def _uninterrupted() -> Generator[None]:
    """Collect no garbage: it may run Python code, in the middle of which another thread may make a tree.

    CPython up to 3.11.7 counts the depth of all trees that are being made in one number, so that both would
    end with a SystemError (github.com/python/cpython/issues/106905).
    """
    with _one_at_a_time:
        collects = gc.isenabled()
        gc.disable()
        try:
            yield
        finally:
            if collects:
                gc.enable()
