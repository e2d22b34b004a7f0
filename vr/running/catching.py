"""Whether a page would catch an error where it waits now, by its source and the stack of its thread."""

from __future__ import annotations

import ast
import builtins
import linecache
from collections.abc import Iterator, Mapping
from functools import lru_cache
from types import FrameType
from typing import TYPE_CHECKING, Any

from robotree.vr.running.page_trace import is_of_page

if TYPE_CHECKING:
    from robotree.vr.running.frame import Frame


def catches(frame: Frame | None, kind: type[BaseException]) -> bool:
    """Whether code of a command that is at work catches errors of a class: by `except`, or by `suppress`.

    Args:
        frame: in which the error would be raised; a part of a command hands it on to what has started it.
        kind: class of the error.
    """
    while frame is not None:
        stack = frame.worker.process.runner.stack_of(frame.worker.thread)
        for at in at_work(stack, frame):
            names = {**vars(builtins), **at.f_globals}
            for caught in _caught(at.f_code.co_filename, at.f_lineno):
                if any(issubclass(kind, each) for each in _classes(caught, names)):
                    return True
        frame = frame.commander
    return False


def at_work(at: FrameType | None, owner: Frame) -> Iterator[FrameType]:
    """Give the functions of a page that a thread carries out for a frame, the innermost first."""
    end, source = type(owner).carry_out.__code__, owner.runtime.source_of(owner.context.command)
    while at is not None and not (at.f_code is end and at.f_locals.get("self") is owner):
        if is_of_page(at, source):
            yield at
        at = at.f_back


def _caught(file: str, line: int) -> Iterator[ast.expr | None]:
    """Give what is caught at a line of a file; None: everything is."""
    for first, last, caught in _blocks(file):
        if first <= line <= last:
            yield from caught


@lru_cache(maxsize=64)
def _blocks(file: str) -> list[tuple[int, int, list[ast.expr | None]]]:
    """Return the blocks of a file in which errors are caught: first and last line, and what is caught."""
    try:
        tree = ast.parse("".join(linecache.getlines(file)))
    except SyntaxError:
        return []
    found: list[tuple[int, int, list[ast.expr | None]]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Try):
            caught: list[ast.expr | None] = [handler.type for handler in node.handlers]
        elif isinstance(node, ast.With):
            caught = [
                one
                for item in node.items
                if isinstance(call := item.context_expr, ast.Call)
                and ast.unparse(call.func).rpartition(".")[2] == "suppress"
                for one in call.args
            ]
        else:
            continue
        found.append((node.body[0].lineno, node.body[-1].end_lineno or node.lineno, caught))
    return found


def _classes(written: ast.expr | None, names: Mapping[str, Any]) -> Iterator[type[BaseException]]:
    """Give the classes of errors that an expression names, as far as it can be read."""
    match written:
        case None:
            yield BaseException
        case ast.Tuple(elts=parts):
            for part in parts:
                yield from _classes(part, names)
        case _:
            found = _found(written, names)
            if isinstance(found, type) and issubclass(found, BaseException):
                yield found


def _found(written: ast.expr, names: Mapping[str, Any]) -> Any:
    match written:
        case ast.Name(id=name):
            return names.get(name)
        case ast.Attribute(value=owner, attr=name):
            return getattr(_found(owner, names), name, None)
        case _:
            return None
