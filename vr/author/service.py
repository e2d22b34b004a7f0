"""Services: pages that work for robots from outside, and bring behaviours along.

    class Greeter(Service):
        robot = Watch("Robot", "who is listened to")
        behaviours = {"greet": GREET}

A service is a virtual robot. It watches robots without a lease, offers commands, streams and readings, and
brings scripts: its behaviours, which are robots named SERVICE-BEHAVIOUR on the same host. They are made with
the service, are inactive until their partners are there, and go with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadName

MOST = 20
"""Behaviours of one service."""


class Service(VirtualRobot):
    """A virtual robot that is there for others, with behaviours of its own."""

    behaviours: ClassVar[Mapping[str, str]] = {}
    """Texts of scripts (YAML) by name. A partner of the service's own kind is the service itself: the first
    behaviour that has such a partner gets it."""

    def __init_subclass__(cls) -> None:
        """Refuse behaviours that cannot be made.

        Raises:
            TypeError: `behaviours` is no mapping of names to texts, or of too many; or see `VirtualRobot`.
        """
        super().__init_subclass__()
        given: Any = cls.behaviours
        if not isinstance(given, Mapping):
            raise TypeError(f'{cls.__name__}.behaviours gives scripts by name: write {{"greet": """…"""}}')
        if len(cls.behaviours) > MOST:
            raise TypeError(f"{cls.__name__} has more behaviours than {MOST}")
        for name, text in cls.behaviours.items():
            both: Any = (name, text)
            if not all(isinstance(one, str) for one in both):
                raise TypeError(f"{cls.__name__}.behaviours: {name!r} and its script must be texts")
            try:
                check_name(name)
            except BadName as error:
                raise TypeError(f"{cls.__name__}.behaviours: {error}") from None
