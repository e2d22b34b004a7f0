"""Which class of a source is meant, and whether it is declared as it should be."""

from __future__ import annotations

from types import ModuleType

from robotree.vr.command import commands_of
from robotree.vr.errors import BrokenSource, NoVirtualRobot, SeveralVirtualRobots
from robotree.vr.virtual_robot import VirtualRobot


def choose(module: ModuleType, path: str, wanted: str) -> type[VirtualRobot]:
    """Return the virtual robot that a module defines.

    Args:
        module: loaded.
        path: of its source, for messages.
        wanted: name of the class; empty: the only one.

    Raises:
        NoVirtualRobot: there is none, or none of the name wanted.
        SeveralVirtualRobots: there are several, and none was named.
        BrokenSource: it declares a command in a way that cannot be called from afar.
    """
    found = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, VirtualRobot) and value.__module__ == module.__name__
    }
    if wanted:
        found = {name: value for name, value in found.items() if name == wanted}
    if not found:
        raise NoVirtualRobot(path=path, wanted=f" named {wanted!r}" if wanted else "")
    if len(found) > 1:
        raise SeveralVirtualRobots(path=path, known=", ".join(found))
    (chosen,) = found.values()
    try:
        commands_of(chosen)
    except TypeError as error:
        raise BrokenSource(path=path, reason=str(error)) from None
    return chosen
