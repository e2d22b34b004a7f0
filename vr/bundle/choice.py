"""Which class of a source is meant, and whether it is declared as it should be."""

from __future__ import annotations

import linecache
from types import ModuleType
from typing import TypeVar

from robotree.vr.bundle.lines import line_of
from robotree.vr.bundle.loader import text_of
from robotree.vr.command import commands_of
from robotree.vr.errors import BrokenSource, NoVirtualRobot, SeveralVirtualRobots
from robotree.vr.robot import Robot
from robotree.vr.virtual_robot import VirtualRobot, slot_specs

_R = TypeVar("_R", bound=Robot)


class NotOne(Exception):
    """A source defines none of the classes meant, or several. Each room makes an error of its own of it."""

    def __init__(self, known: tuple[str, ...], wanted: str) -> None:
        """Take the names of those that it defines, and the name that was wanted or an empty one."""
        super().__init__(known, wanted)
        self.known, self.wanted = known, wanted

    @property
    def named(self) -> str:
        """The words ` named 'NAME'`, or none when no name was wanted."""
        return f" named {self.wanted!r}" if self.wanted else ""


def only_class(module: ModuleType, base: type[_R], path: str, wanted: str) -> type[_R]:
    """Return the one class of a kind that a module defines.

    Args:
        module: loaded.
        base: from which it derives.
        path: of its source, for messages.
        wanted: name of the class; empty: the only one.

    Raises:
        NotOne: there is none, or none of the name wanted, or several and none was named.
        BrokenSource: it declares a command in a way that cannot be called from afar.
    """
    found = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, base) and value.__module__ == module.__name__
    }
    if wanted:
        found = {name: value for name, value in found.items() if name == wanted}
    if len(found) != 1:
        raise NotOne(tuple(found), wanted)
    (chosen,) = found.values()
    try:
        commands_of(chosen)
        if issubclass(chosen, VirtualRobot):
            slot_specs(chosen)
    except TypeError as error:
        line = line_of("".join(linecache.getlines(text_of(chosen))), str(error))
        raise BrokenSource(path=path, reason=f"{f'line {line}: ' if line else ''}{error}") from None
    return chosen


def choose(module: ModuleType, path: str, wanted: str) -> type[VirtualRobot]:
    """Return the virtual robot that a module defines; arguments as for `only_class`.

    Raises:
        NoVirtualRobot: there is none, or none of the name wanted.
        SeveralVirtualRobots: there are several, and none was named.
        BrokenSource: it declares a command in a way that cannot be called from afar.
    """
    try:
        return only_class(module, VirtualRobot, path, wanted)
    except NotOne as error:
        if error.known:
            raise SeveralVirtualRobots(path=path, known=", ".join(error.known)) from None
        raise NoVirtualRobot(path=path, wanted=error.named) from None
