"""Reads Python into a tree without running it, in this one place, and finds lines of a page there."""

from __future__ import annotations

import ast
import gc
import re
from collections.abc import Generator
from contextlib import contextmanager
from threading import Lock

TOO_DEEP = "brackets, signs or words are nested too deeply"
"""Where Python says MemoryError or RecursionError, and no line."""
_one_at_a_time = Lock()
_ABOUT = re.compile(r"(?:default of )?(\w+)(?:\.|: )(\w+)\b(?:: (?:parameter '(\w+)'|(\w+):))?")
_FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef


def parse(source: str) -> ast.Module:
    """Return the tree of a page.

    Raises:
        SyntaxError: it is no Python, or nested too deeply.
        ValueError: it has null bytes.
    """
    with _uninterrupted():
        return ast.parse(source)


def parse_expression(source: str) -> ast.expr:
    """Return the tree of an expression.

    Raises:
        SyntaxError: it is none, or nested too deeply.
        ValueError: it has null bytes.
    """
    with _uninterrupted():
        return ast.parse(source, mode="eval").body


@contextmanager
def _uninterrupted() -> Generator[None]:
    """Collect no garbage, and say in words that Python gave up.

    A collection may run Python code, in the middle of which another thread may make a tree: CPython up to
    3.11.7 counts the depth of all trees that are being made in one number, so that both would end with a
    SystemError (github.com/python/cpython/issues/106905).
    """
    with _one_at_a_time:
        collects = gc.isenabled()
        gc.disable()
        try:
            yield
        except (RecursionError, MemoryError):
            raise SyntaxError(TOO_DEEP) from None
        finally:
            if collects:
                gc.enable()


def line_of(source: str, sentence: str) -> int:
    """Return the line of the attribute or parameter that a sentence (`Team.rovers is …`) is about, or 0."""
    about = _ABOUT.match(sentence)
    if about is None:
        return 0
    owner, attribute, parameter = about[1], about[2], about[3] or about[4]
    for node in ast.walk(parse(source)):
        if isinstance(node, ast.ClassDef) and node.name == owner:
            return _line_in(node, attribute, parameter)
    return 0


def slots_at(source: str, line: int) -> list[str]:
    """Return the slots that the class around a line declares above it."""
    found: list[str] = []
    for node in ast.walk(parse(source)):
        if isinstance(node, ast.ClassDef) and node.lineno < line <= (node.end_lineno or 0):
            for item in node.body:
                match item:
                    case ast.Assign(
                        targets=[ast.Name(id=name)],
                        value=ast.Call(func=ast.Name(id="Child" | "Children")),
                        lineno=number,
                    ) if number < line:
                        found.append(name)
                    case _:
                        pass
    return found


def _line_in(owner: ast.ClassDef, attribute: str, parameter: str | None) -> int:
    for node in owner.body:
        if isinstance(node, _FUNCTIONS) and node.name == attribute:
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            named = (argument.lineno for argument in arguments if argument.arg == parameter)
            return next(named, node.lineno)
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(isinstance(target, ast.Name) and target.id == attribute for target in targets):
                return node.lineno
    return owner.lineno
