"""Checks of the policy of a realm: what it denies to who asks here, with the line that does."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from robotree.tui.diagnosis.finding import Finding
from robotree.vr.base.policy import PolicyTarget
from robotree.vr.base.principal import user_name

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

MANY = 8
"""Robots that one finding names."""


def permits(realm_client: RealmClient, robots: Iterable[RobotDescription], name: str) -> Iterator[Finding]:
    """Say which policy is in force, and what it denies; nothing where there is none.

    Args:
        realm_client: which has looked around.
        robots: that may be seen.
        name: of a robot that is missed; empty: none.
    """
    gate = realm_client.gate
    if not gate.closed:
        return
    ask = f"ask {gate.ask}"
    if gate.policy is None:
        remedy = f"robotree policy check FILE, robotree policy set FILE; {ask}"
        yield Finding("policy", "bad", gate.trouble, remedy)
        return
    me = gate.user(user_name(os.geteuid()))
    roles = ", ".join(dict.fromkeys(each.role for each in gate.policy.roles_of(me)))
    who = f"{me.name} ({roles or 'guest: it may only stop'})"
    yield Finding("policy", "good", f"version {gate.policy.version} is in force; you are {who}")
    denied = dict[str, list[str]]()
    for robot in robots:
        commands = [spec.name for spec in robot.commands] or [""]
        found = [realm_client.refused("command", robot.name, robot.kinds, each) for each in commands]
        if all(one is not None for one in found) and (first := found[0]) is not None:
            denied.setdefault(first.data["reason"], []).append(robot.name)
    for reason, names in denied.items():
        more = f" and {len(names) - MANY} others" if len(names) > MANY else ""
        what = f"the policy denies {me.name} to command {', '.join(names[:MANY])}{more}: {reason}"
        yield Finding("policy", "doubt", what, ask)
    if name and (hidden := unseen(realm_client, name)):
        what = f"{name} runs, and the policy denies {me.name} to see it: {hidden}"
        yield Finding("robot", "bad", what, ask)


def unseen(realm_client: RealmClient, name: str) -> str:
    """Return why a robot that runs may not be seen by who asks here; empty: it may, or does not run."""
    for address in realm_client.directory.present("robot", name):
        if realm_client.hides(address):
            target = PolicyTarget(address.plain_name, "robot", (), "", realm_client.gate.site)
            found = realm_client.denial("see", target)
            return "" if found is None else found.reason
    return ""
