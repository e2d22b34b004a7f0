"""Services: pages that work for robots from outside, and bring behaviours along.

    class Greeter(Service):
        robot = Watch("Robot", "who is listened to")
        behaviours = {"greet": GREET}

A service is a virtual robot. It watches robots without a lease, offers commands, streams and readings, and
brings scripts: its behaviours, which are robots named SERVICE-BEHAVIOUR on the same host. They are made with
the service, are inactive until their partners are there, and go with it. It lends roles: robots that play
roles can play SERVICE-ROLE as long as the service is listed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, cast

from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadName

MOST = 20
"""Behaviours, and roles, of one service."""
LARGEST_ROLES = 10_000
"""Characters of the roles of one service: every lookup service has them."""


class Service(VirtualRobot):
    """A virtual robot that is there for others, with behaviours of its own."""

    behaviours: ClassVar[Mapping[str, str]] = {}
    """Texts of scripts (YAML) by name. A partner of the service's own kind is the service itself: the first
    behaviour that has such a partner gets it."""
    lends: ClassVar[Mapping[str, str]] = {}
    """Texts of roles (YAML) by name, which robots play as SERVICE-ROLE, and forget when it leaves."""

    def __init_subclass__(cls) -> None:
        """Refuse behaviours that cannot be made, and roles that cannot be lent.

        Raises:
            TypeError: `behaviours` or `lends` is no mapping of names to texts, or of too many, or too long;
                or see `VirtualRobot`.
        """
        super().__init_subclass__()
        _expect_texts(f"{cls.__name__}.behaviours", cls.behaviours, "script", "greet")
        expect_lendable(f"{cls.__name__}.lends", cls.lends)


def expect_lendable(where: str, given: Any) -> dict[str, str]:
    """Return a copy of the roles that a service lends, texts by name, if they can be lent.

    A name has no `-`, so that `desk-a-b` is a role of `desk-a`, and never one of `desk`.

    Args:
        where: they come from, for people.
        given: they may be anything.

    Raises:
        TypeError: they cannot; says why.
    """
    roles = _expect_texts(where, given, "role", "clerk")
    for name in roles:
        if "-" in name:
            raise TypeError(f"{where}: {name!r} has a '-', which parts a service from its role; leave it out")
    if sum(map(len, roles.values())) > LARGEST_ROLES:
        raise TypeError(f"{where} has more than {LARGEST_ROLES} characters")
    return roles


def _expect_texts(where: str, given: Any, noun: str, example: str) -> dict[str, str]:
    """Return a copy of texts by name; refuse what gives none.

    Raises:
        TypeError: says what is wrong.
    """
    if not isinstance(given, Mapping):
        raise TypeError(f'{where} gives a {noun} by name: write {{"{example}": """…"""}}')
    texts = dict(cast("Mapping[object, object]", given))
    if len(texts) > MOST:
        raise TypeError(f"{where} has more than {MOST}")
    for name, text in texts.items():
        if not (isinstance(name, str) and isinstance(text, str)):
            raise TypeError(f"{where}: {name!r} and its {noun} must be texts")
        try:
            check_name(name)
        except BadName as error:
            raise TypeError(f"{where}: {error}") from None
    return cast("dict[str, str]", texts)
