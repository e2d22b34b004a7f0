"""A group of robots under one name: by names, by a rule, or by place. Pure.

A group is a word of people: it has no agent and no lease. Who gives an order to it gives the same order to
each member, with the rights that he has there, and gets an answer from each.
"""

from __future__ import annotations

import msgspec

from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadGroup, VrError

MOST = 1000
"""Names in one group."""
LONGEST = 2000
"""Letters of a rule."""


class RobotGroup(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One group."""

    name: str
    names: tuple[str, ...] = ()
    """Its members by name, whether they are there or not."""
    rule: str = ""
    """What other members are (`scripts/requirement.py`): `kind = Rover & battery > 30`; empty: none."""

    @property
    def about(self) -> str:
        """Whom it has, in words."""
        parts = [", ".join(self.names)] if self.names else []
        return " and ".join([*parts, *([f"all where {self.rule}"] if self.rule else [])])


def rule_of(where: str, near: str) -> str:
    """Return the rule of those that fulfil `where` and are near a place; empty: neither is said.

    Args:
        where: a rule; empty: none.
        near: name of a place, without quotes in it; empty: none.
    """
    place = f"near '{near}'" if near else ""
    return f"({where}) and {place}" if where and place else where or place


def checked(group: RobotGroup) -> RobotGroup:
    """Return a group if it can be one.

    Raises:
        BadName: its name, or that of a member, cannot be one.
        BadGroup: it has nobody, or too many.
    """
    check_name(group.name)
    for name in group.names:
        try:
            check_name(name)
        except VrError as error:
            raise BadGroup(group=group.name, reason=str(error)) from None
    if not group.names and not group.rule.strip():
        raise BadGroup(
            group=group.name, reason="it has nobody: name robots, or say where, or near which place"
        )
    if len(group.names) > MOST or len(group.rule) > LONGEST:
        raise BadGroup(group=group.name, reason=f"more than {MOST} names, or {LONGEST} letters of a rule")
    if group.name in group.names:
        raise BadGroup(group=group.name, reason="it cannot be a member of itself")
    return group
