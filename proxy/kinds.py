"""The kinds of robots that there is a proxy for: those below by name, and any other from a file."""

from __future__ import annotations

from typing import Any

from robotree.proxy import kind_file
from robotree.proxy.arm import Arm
from robotree.proxy.errors import UnknownKind
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.rover import Rover

KINDS: dict[str, type[RobotProxy]] = {"arm": Arm, "rover": Rover}


def make(kind: str, name: str, url: str, **options: Any) -> RobotProxy:
    """Return the proxy of one robot.

    Args:
        kind: what it is: one of `KINDS`, or `FILE.py` or `FILE.py:CLASS`; a file is run, which blocks.
        name: what it is called.
        url: where its controller listens.
        **options: as `RobotProxy` takes them.

    Raises:
        UnknownKind: there is no such kind.
        NoKind: the file defines none, or none of the name wanted.
        SeveralKinds: the file defines several, and none was named.
        BundleError: the file cannot be used.
        BadName: that cannot be a name.
    """
    if kind_file.is_file(kind):
        return kind_file.make(kind, name, url, **options)
    if kind not in KINDS:
        raise UnknownKind(kind=kind, known=", ".join(KINDS))
    return KINDS[kind](name, url, **options)
