"""Checks of the agents of a realm: how each robot is, why one is not listed, what the policy denies here."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from robotree.client.joining import joined
from robotree.tui.diagnosis import meeting, sites
from robotree.tui.diagnosis.finding import Finding
from robotree.tui.line import away
from robotree.tui.seen import status
from robotree.vr.base.errors import NoSuchRobot, RobotAway
from robotree.vr.base.policy import PolicyTarget
from robotree.vr.base.principal import user_name

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.requests import HostDescribed
    from robotree.vr.supervision.realm_client import RealmClient


async def agents(realm: str, name: str, entries: Sequence[meeting.Entry]) -> list[Finding]:
    """Ask all robots how they are.

    Args:
        realm: whose folder is sound.
        name: of a robot that is missing; empty: none.
        entries: the realm's processes.
    """
    async with joined(realm) as realm_client:
        robots = {robot.name: robot for robot in await realm_client.tree()}
        listed = {one.name for one in realm_client.robots()}
        hosts = await realm_client.hosts()
        elsewhere = await sites.sites(realm_client, realm, name)
        elsewhere += permits(realm_client, robots.values(), name)
    found = [finding for robot in robots.values() for finding in condition(robot)]
    found += standing_by(hosts)
    found += [
        Finding("hosts", "bad", f"host {one.address.name}: {fact}", remedy)
        for one in hosts
        for fact, _, remedy in [one.trouble.partition("; ")]
        if fact
    ]
    if not robots:
        found.append(
            Finding("robots", "doubt", "no robot answers", "robotree proxy arm arm-1 --connect tcp:HOST:PORT")
        )
    found += elsewhere
    if name and not any(finding.check == "robot" for finding in elsewhere):
        found += missed(name, realm, robots, listed, entries)
    return found


def standing_by(hosts: Sequence[HostDescribed]) -> Iterator[Finding]:
    """Say which hosts stand by, and where one that has taken over has nobody who would take over from it."""
    watched = {host.stands_by for host in hosts}
    for host in hosts:
        name, before = host.address.name, host.instead_of
        if host.stands_by:
            yield Finding("hosts", "good", f"{name} stands by for {host.stands_by}")
        elif before and name not in watched:
            said = f"{name} has the robots of {before}, and no host stands by for it"
            yield Finding("hosts", "doubt", said, f"robotree host {before}: it stands by then")
        elif before:
            yield Finding("hosts", "good", f"{name} has the robots of {before}")


def condition(robot: RobotDescription) -> Iterator[Finding]:
    """Say how a robot is, and what to do where it cannot be commanded."""
    lacks = status.lacks_of(robot)
    kind = status.status_of(robot, lacks)
    result = f"{robot.name} ({robot.kind}) is {status.words(robot)}"
    match kind:
        case "offline":
            remedy = "its proxy has lost the controller: look whether that runs and at the link between them"
            remedy = robot.attributes.get(status.CONDITION, remedy)
            yield Finding("robots", "bad", result, remedy)
        case "stopped":
            reason = f": {robot.stop_reason}" if robot.stop_reason else ""
            yield Finding(
                "robots", "doubt", result + reason, f"when it is safe: robotree resume {robot.name}"
            )
        case "abandoned":
            host = f"host {robot.host}" if robot.host else "its process"
            remedy = f"code of {', '.join(robot.abandoned)} was ended and still runs: restart {host}"
            yield Finding("robots", "bad", result, remedy)
        case "needs":
            slot, wanted, *_ = lacks[0]
            remedy = f"robotree enslave {robot.name}.{slot} NAME, of a robot of kind {wanted}"
            yield Finding("robots", "doubt", f"{robot.name} ({robot.kind}): {status.needs(lacks)}", remedy)
        case _:
            yield Finding("robots", "good", result)


def missed(
    name: str,
    realm: str,
    robots: Mapping[str, RobotDescription],
    listed: set[str],
    entries: Sequence[meeting.Entry],
) -> Iterator[Finding]:
    """Say why a robot is not seen."""
    holders = [entry for entry in entries if any(each.name == name for each in entry.holds)]
    robot = robots.get(name)
    if robot is not None and robot.bond is not None:
        parent = f"{robot.bond.parent.name}.{robot.bond.slot}"
        result = f"{name} runs and is enslaved by {parent}: it is in `robotree tree`, not in `robotree ls`"
        yield Finding("robot", "good", result, f"to command it yourself: robotree release {parent}")
    elif robot is not None and name in listed:
        yield Finding("robot", "good", f"{name} runs, answers and is listed")
    elif robot is not None:
        yield Finding(
            "robot", "bad", f"{name} runs and answers, but no lookup service lists it",
            "start one if there is none: robotree lookup lookup-1; else it is listed within 2 s",
        )  # fmt: skip
    elif holders:
        one = holders[0]
        result = (
            f"{name} is in {one.who}, which {'is stopped' if one.condition == 'stopped' else one.condition}"
        )
        wake = (
            f"kill -CONT {one.pid}"
            if one.condition == "stopped"
            else f"kill -KILL {one.pid}, and start it again"
        )
        yield Finding("robot", "bad", f"{result} and does not answer", wake)
    elif elsewhere := meeting.whereabouts(name, realm):
        yield elsewhere
    elif isinstance(kept := away.explained(realm, NoSuchRobot(name=name)), RobotAway):
        host, since = kept.data["host"], kept.data["since"]
        result = f"{name} is kept by host {host}, which wrote last {since} ago"
        yield Finding("robot", "bad", result, f"robotree host {host}")
    else:
        near = difflib.get_close_matches(name, robots, n=2)
        meant = f"did you mean {' or '.join(near)}? Else " if near else ""
        yield Finding(
            "robot", "bad", f"no process of this user's realms is {name}",
            f"{meant}look whether its proxy or its host runs, on this machine and as the same user",
        )  # fmt: skip


# -- permits ---------------------------------------------------------------------------------------

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
