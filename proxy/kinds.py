"""The kinds of robots that a proxy can stand for: the built-in ones by name, any other from a file.

A file of a kind is the user's own: it is named on the command line (`robotree proxy conveyor.py belt-1 …`)
and runs in the user's own process. It is loaded like the source of a virtual robot, so that every mistake in
it is reported as one sentence with its line.
"""

from __future__ import annotations

from typing import Any

from robotree.proxy.arm import Arm
from robotree.proxy.base import Base
from robotree.proxy.errors import NoKind, SeveralKinds, UnknownKind
from robotree.proxy.head import Head
from robotree.proxy.limb import Limb
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.rover import Rover
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.loader import make as make_robot

KINDS: dict[str, type[RobotProxy]] = {"arm": Arm, "rover": Rover, "limb": Limb, "base": Base, "head": Head}


def make(kind: str, name: str, url: str, **options: Any) -> RobotProxy:
    """Return the proxy of one robot. A file is run here, and its constructor too, which blocks.

    Args:
        kind: one of `KINDS`, or `FILE.py` or `FILE.py:CLASS`.
        name: of the robot.
        url: where its controller listens.
        **options: as `RobotProxy` takes them.

    Raises:
        UnknownKind: there is no such kind.
        NoKind: the file defines none, or none of the name wanted.
        SeveralKinds: the file defines several, and none was named.
        BundleError: the file cannot be used, or its constructor raises or does not end.
        BadName: that cannot be a name.
    """
    path, wanted = _split(kind)
    if path.endswith(".py"):
        cls = Bundle.read(path, wanted).load_class(RobotProxy, NoKind, SeveralKinds)
        return make_robot(cls, lambda: cls(name, url, **options), name, path, takes="name, url, **options")
    if kind not in KINDS:
        raise UnknownKind(kind=kind, known=", ".join(KINDS))
    return KINDS[kind](name, url, **options)


def _split(kind: str) -> tuple[str, str]:
    path, colon, wanted = kind.rpartition(":")
    return (path, wanted) if colon else (kind, "")
