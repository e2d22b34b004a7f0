"""The kinds of robots that there is a proxy for. A new kind is its class and one line here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robotree.proxy.arm import Arm
from robotree.proxy.errors import UnknownKind
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.rover import Rover

KINDS: dict[str, Callable[..., RobotProxy]] = {"arm": Arm, "rover": Rover}


def make(kind: str, name: str, url: str, **options: Any) -> RobotProxy:
    """Return the proxy of one robot.

    Args:
        kind: what it is.
        name: what it is called.
        url: where its controller listens.
        **options: as the class takes them.

    Raises:
        UnknownKind: there is no such kind.
        BadName: that cannot be a name.
    """
    if kind not in KINDS:
        raise UnknownKind(kind=kind, known=", ".join(KINDS))
    return KINDS[kind](name, url, **options)
