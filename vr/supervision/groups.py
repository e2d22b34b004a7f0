"""Who is in a group now: those whom it names, and those that fulfil its rule."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from robotree.vr.base.description import RobotDescription
from robotree.vr.base.group import RobotGroup
from robotree.vr.scripts.requirement import KnownRobot, member_rule, requirement
from robotree.vr.supervision.realm_client import RealmClient


class GroupMember(NamedTuple):
    """One robot of a group."""

    name: str
    robot: RobotDescription | None = None
    """None: it is not there, or does not answer."""
    why: str = ""
    """Why it is one, in words: by name, or what it says where the rule asks."""
    there: bool = True
    """Whether a robot of this name is seen alive."""
    sure: bool = True
    """False: it does not answer, so nobody knows whether it fulfils the rule."""


async def members_of(realm_client: RealmClient, group: RobotGroup) -> Sequence[GroupMember]:
    """Return the members of a group, by name.

    A robot that lives and does not answer may fulfil a rule: it is returned as one that nobody is sure of.

    Args:
        realm_client: sees the robots.
        group: whose rule is checked.

    Raises:
        VrError: its rule cannot be read, or names a group that there is not.
    """
    return members_among(realm_client, group, await realm_client.tree())


def members_among(
    realm_client: RealmClient, group: RobotGroup, tree: Iterable[RobotDescription]
) -> Sequence[GroupMember]:
    """Return the same from what robots have just said of themselves (`RealmClient.tree`)."""
    rule = member_rule(group, realm_client.groups.find)
    asked = requirement(group.rule)
    robots = {robot.name: robot for robot in tree}
    present = {address.name for address in realm_client.directory.present("robot")}
    found: dict[str, GroupMember] = {}
    for name, robot in robots.items():
        if name in group.names:
            found[name] = GroupMember(name, robot, "by name")
        elif rule.holds(KnownRobot.described(robot)):
            found[name] = GroupMember(name, robot, asked.seen(KnownRobot.described(robot)) or "by rule")
    for name in group.names:
        found.setdefault(name, GroupMember(name, None, "by name", name in present))
    if group.rule:
        for name in present - robots.keys() - found.keys():
            found[name] = GroupMember(name, None, "does not answer", sure=False)
    return [found[name] for name in sorted(found)]
