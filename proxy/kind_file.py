"""A kind of robot from a file of somebody's own: `robotree proxy conveyor.py belt-1 …`.

The file is the user's, named on the user's command line and run in the user's own process. It is loaded as
the source of a virtual robot is, so that whatever is wrong with it is one sentence with the line.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

from robotree.proxy.errors import NoKind, SeveralKinds
from robotree.proxy.robot_proxy import RobotProxy
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.loader import LIMIT, load_module, within
from robotree.vr.command import commands_of
from robotree.vr.errors import BrokenSource

SUFFIX = ".py"


def is_file(kind: str) -> bool:
    """Whether a word means a file, `FILE.py` or `FILE.py:CLASS`, rather than the name of a kind."""
    return _split(kind)[0].endswith(SUFFIX)


def load(kind: str) -> type[RobotProxy]:
    """Run a file and return the kind that it defines. Blocks until the file has run.

    Args:
        kind: `FILE.py`, or `FILE.py:CLASS` when there are several.

    Raises:
        NoSuchFile: it cannot be read.
        BrokenSource: it does not compile, raises, does not end, or declares a command wrongly.
        NoKind: it defines no kind of robot, or none of the name wanted.
        SeveralKinds: it defines several, and none was named.
    """
    path, wanted = _split(kind)
    bundle = Bundle.read(path)
    chosen = _choose(load_module(bundle.source, path, bundle.hash), path, wanted)
    try:
        commands_of(chosen)
    except TypeError as error:
        raise BrokenSource(path=path, reason=str(error)) from None
    return chosen


def make(kind: str, name: str, url: str, **options: Any) -> RobotProxy:
    """Return the proxy of one robot of a kind from a file. Blocks until its constructor has run.

    Args:
        kind: as for `load`.
        name: what it is called.
        url: where its controller listens.
        **options: as `RobotProxy` takes them.

    Raises:
        BadName: that cannot be a name.
        BundleError: the file cannot be used, or the constructor raises or does not end.
        ProxyError: see `load`.
    """
    cls, path = load(kind), _split(kind)[0]
    file = str(sys.modules[cls.__module__].__file__)
    robot = within(lambda: cls(name, url, **options), path, file, LIMIT)
    if getattr(robot, "name", None) != name:
        reason = f"{cls.__name__}.__init__ must call super().__init__(name, url, **options)"
        raise BrokenSource(path=path, reason=reason)
    return robot


def _split(kind: str) -> tuple[str, str]:
    path, colon, wanted = kind.rpartition(":")
    return (path, wanted) if colon else (kind, "")


def _choose(module: ModuleType, path: str, wanted: str) -> type[RobotProxy]:
    found = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, RobotProxy) and value.__module__ == module.__name__
    }
    if wanted:
        found = {name: value for name, value in found.items() if name == wanted}
    if not found:
        raise NoKind(path=path, wanted=f" named {wanted!r}" if wanted else "")
    if len(found) > 1:
        raise SeveralKinds(path=path, known=", ".join(found))
    (chosen,) = found.values()
    return chosen
