"""Error classes of pages: named on the way, and found again in the page that takes them.

No code travels. A class is known by its name and the SHA-256 of the text of the file that defines it. It is
looked up only in the page of the robot that made the call, and in the modules that this page imports.
"""

from __future__ import annotations

import hashlib
import linecache
import sys
import sysconfig
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from robotree.vr.base.errors import PRIVATE_MODULE, CommandFailed, VrError
from robotree.vr.base.own_class import OwnClass
from robotree.vr.base.plain import to_plain
from robotree.vr.base.units import shorten

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
