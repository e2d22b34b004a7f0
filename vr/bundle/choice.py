"""Which class of a source is meant, and whether it is declared as it should be."""

from __future__ import annotations

import linecache
from types import ModuleType
from typing import TypeVar

from robotree.vr.bundle.lines import line_of
from robotree.vr.bundle.loader import text_of
from robotree.vr.command import commands_of
from robotree.vr.errors import BrokenSource, VrError
from robotree.vr.robot import Robot
from robotree.vr.virtual_robot import VirtualRobot, slot_specs

_R = TypeVar("_R", bound=Robot)


def only_class(
    module: ModuleType,
    base: type[_R],
    path: str,
    wanted: str,
    *,
    none: type[VrError],
    several: type[VrError],
) -> type[_R]:
    """Return the one class of a kind that a module defines.

    Args:
        module: loaded.
        base: from which it derives.
        path: of its source, for messages.
        wanted: name of the class; empty: the only one.
        none: the error if there is none, or none of the name wanted; takes `path` and `wanted`.
        several: the error if there are several, and none was named; takes `path` and `known`.

    Raises:
        VrError: one of these two.
        BrokenSource: it declares a command in a way that cannot be called from afar.
    """
    found = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, base) and value.__module__ == module.__name__
    }
    if wanted:
        found = {name: value for name, value in found.items() if name == wanted}
    if not found:
        raise none(path=path, wanted=f" named {wanted!r}" if wanted else "")
    chosen, *others = found.values()
    if others:
        raise several(path=path, known=", ".join(found))
    try:
        commands_of(chosen)
        if issubclass(chosen, VirtualRobot):
            slot_specs(chosen)
    except TypeError as error:
        line = line_of("".join(linecache.getlines(text_of(chosen))), str(error))
        raise BrokenSource(path=path, reason=f"{f'line {line}: ' if line else ''}{error}") from None
    return chosen
