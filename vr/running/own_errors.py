"""Error classes of pages: named on the way, and found again in the page that takes them.

No code travels. A class is known by its name and the SHA-256 of the text of the file that defines it. It is
looked up only in the page of the robot that made the call, and in the modules that this page imports.
"""

from __future__ import annotations

import hashlib
import linecache
import logging
import sys
import sysconfig
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from robotree.vr.author.context import CommandContext
from robotree.vr.base.errors import (
    PRIVATE_MODULE,
    BadArgument,
    CommandError,
    CommandFailed,
    Failed,
    NoSuchCommand,
    VrError,
    words_of,
)
from robotree.vr.base.own_class import OwnClass
from robotree.vr.base.plain import to_plain
from robotree.vr.base.requests import Raised
from robotree.vr.base.units import shorten
from robotree.vr.running.page_trace import PageLine, is_of_page, page_lines, trace_of

_INSTALLED = tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")})
"""Folders of Python and of its packages: their classes belong to no page."""
_OURS = frozenset({"data", "trace", "entered", "own_class"})
"""Attributes of a `VrError` that travel in another way, or not at all."""


def own_class_of(error: BaseException) -> OwnClass | None:
    """Describe the class of an error, if a page defines it; None: another source does."""
    digest = _digest(type(error)) if isinstance(error, Exception) else ""
    if not digest:
        return None
    values = {name: travelling(value) for name, value in vars(error).items() if name not in _OURS}
    return OwnClass(
        name=type(error).__qualname__,
        digest=digest,
        arguments=tuple(map(travelling, error.args)),
        values=values,
    )


def as_itself(page: type[Any], error: VrError) -> Exception:
    """Return an error of a child as an instance of its own class, if the page of its caller knows that class.

    The constructor of the class is not called. An error that is no `VrError` has the child's as its cause.

    Args:
        page: class of the calling robot.
        error: as it came.
    """
    own = error.own_class
    if own is None:
        return error
    cls = next(
        (cls for cls in _classes(page) if cls.__qualname__ == own.name and _digest(cls) == own.digest), None
    )
    if cls is None or VrError.registered(cls, CommandFailed) is not type(error):
        return error
    try:
        known = cls.__new__(cls, *own.arguments)
        vars(known).update(own.values)
    except Exception:  # noqa: BLE001 # the class is the author's
        return error
    if isinstance(known, VrError):
        known.args, known.data, known.trace, known.own_class = error.args, error.data, error.trace, own
    else:
        known.__cause__ = error
    return known


def travelling(value: Any) -> Any:
    """Return a value as a plain one; what cannot travel becomes a text."""
    try:
        return to_plain(value)
    except TypeError:
        return shorten(value)


def _classes(page: type[Any]) -> Iterator[type[Exception]]:
    """Yield the error classes that a page defines or imports, and those of the modules that it imports."""
    names = vars(sys.modules[page.__module__])
    modules = [value for value in tuple(names.values()) if isinstance(value, ModuleType)]
    for space in (names, *map(vars, modules)):
        for value in tuple(space.values()):
            if isinstance(value, type) and issubclass(value, Exception):
                yield value


def _digest(cls: type[Any]) -> str:
    """Return the SHA-256, in hex, of the text that defines a class of a page; empty: it is of no page."""
    name = cls.__module__
    module = sys.modules.get(name)
    file = getattr(module, "__file__", None)
    if module is None or not file or name.startswith("robotree."):
        return ""
    if not name.startswith(PRIVATE_MODULE) and file.startswith(_INSTALLED):
        return ""
    text = "".join(linecache.getlines(file, vars(module))).rstrip("\n")
    return hashlib.sha256(text.encode()).hexdigest() if text else ""


_log = logging.getLogger(__name__)


def raised(robot: str, context: CommandContext, error: BaseException, *, source: str = "") -> Raised:
    """Pack the error of a command that did not succeed, with the trace of its page.

    Args:
        robot: its name.
        context: of the command.
        error: errors of robots go on as they are, all others are the author's.
        source: path of the author's file, to name the line.
    """
    label, lines = f"{robot}.{context.command}", page_lines(error, source)
    trace = trace_of(label, error, source)
    known = error if isinstance(error, VrError) else None
    begins_here = known is None or (isinstance(known, CommandError) and _is_the_authors(known))
    if known is None:
        where = f" ({lines[-1].place})" if lines else ""
        known = CommandFailed(robot=robot, command=context.command, detail=words_of(error) + where)
    elif (
        isinstance(known, (BadArgument, NoSuchCommand))
        and lines
        and not known.trace
        and _raised_by_a_call(error, source)
    ):
        known = _refused_by_a_child(known, lines[-1])
    if isinstance(known, Failed):
        known.data["values"] = {name: travelling(value) for name, value in known.data["values"].items()}
    if isinstance(known, CommandError):
        known.fill_in(robot, context.command)
    if begins_here:
        _log.warning("%s", "\n".join([str(known), *trace]))
    known.trace, known.own_class = trace, own_class_of(error) or known.own_class
    return Raised.of(known)


def _is_the_authors(error: CommandError) -> bool:
    return "" in (error.data.get("robot"), error.data.get("command"))


def _raised_by_a_call(error: BaseException, source: str) -> bool:
    """Return whether robotree raised it below the page, as for a child; else the page refuses its caller."""
    step, below = error.__traceback__, False
    while step is not None:
        ours = str(step.tb_frame.f_globals.get("__name__", "")).startswith("robotree.vr.")
        below = not is_of_page(step.tb_frame, source) and (below or ours)
        step = step.tb_next
    return below


def _refused_by_a_child(error: BadArgument | NoSuchCommand, line: PageLine) -> VrError:
    """Return the refusal of a call with the line of the page that made it; an author's own stays as it is."""
    if _is_the_authors(error):
        return error
    last = "reason" if isinstance(error, BadArgument) else "known"
    return type(error)(**error.data | {last: f"{error.data[last]} ({line.place})"})
