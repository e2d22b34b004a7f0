"""Groups on the command line, at the prompt and in sessions: made, shown, and given orders as one.

An order to a group is the same order to each member, at the same time. Each answers for itself; where some
have not done it, their reasons are told, and the exit code says so.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from robotree.tui.errors import BadLine, SomeFailed, SupervisorError, ValueRefused, sentence
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Run, Teller
from robotree.tui.seen import status, wording

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.group import RobotGroup
    from robotree.vr.supervision.groups import GroupMember
    from robotree.vr.supervision.realm_client import RealmClient

UNSURE = frozenset({"stop"})
"""Verbs that also reach robots that may be members: nobody knows, for they do not answer."""


class _Prefixed:
    """A teller for one member: what it says begins with its name."""

    def __init__(self, teller: Teller, name: str) -> None:
        self._teller, self._name = teller, name

    def progress(self, fraction: float, text: str) -> None:
        if text or fraction:  # else it has only begun, as all have
            self._teller.progress(fraction, f"{self._name}: {text}".removesuffix(": "))

    def warn(self, text: str) -> None:
        self._teller.warn(f"{self._name}: {text}")

    def outcome(self, outcome: Outcome) -> None:
        self._teller.outcome(outcome)


def meant(realm_client: RealmClient, line: Line) -> str:
    """Return the group that a line names instead of a robot; empty: it names none.

    A robot that is there comes before a group of the same name.
    """
    blank = BY_VERB[line.verb].members
    name = line.text(blank).partition(".")[0] if blank else ""
    if not name or name not in realm_client.groups.names() or realm_client.directory.present("robot", name):
        return ""
    return name


async def for_all(run: Run, realm_client: RealmClient, line: Line, teller: Teller, name: str) -> Outcome:
    """Carry a line out for each member of a group.

    Raises:
        VrError: the group cannot be read, or nobody is in it.
    """
    from robotree.vr.base.errors import GroupEmpty
    from robotree.vr.supervision.groups import members_of

    group = realm_client.groups.find(name)
    members = [one for one in await members_of(realm_client, group) if one.sure or line.verb in UNSURE]
    if not members:
        raise GroupEmpty(group=name, about=group.about)
    results = await asyncio.gather(
        *(_one(run, realm_client, _for(line, name, one.name), teller, one) for one in members)
    )
    rows = [(one.name, *_told(result)) for one, result in zip(members, results, strict=True)]
    failed = [
        (one.name, sentence(result))
        for one, result in zip(members, results, strict=True)
        if isinstance(result, Exception)
    ]
    data = {"group": name, "members": [_data(one, each) for one, each in zip(members, results, strict=True)]}
    doubt = SomeFailed(line.verb, name, len(members), failed) if failed else None
    return Outcome(data, wording.columns(rows), doubt)


def _for(line: Line, group: str, member: str) -> Line:
    """Return the same line for one member."""
    blank = BY_VERB[line.verb].members
    text = member + line.text(blank)[len(group) :]
    return line._replace(values={**line.values, blank: text}, order="")


async def _one(
    run: Run, realm_client: RealmClient, line: Line, teller: Teller, member: GroupMember
) -> Outcome | Exception:
    from robotree.vr.base.errors import VrError

    try:
        return await run(realm_client, line, _Prefixed(teller, member.name))
    except (VrError, SupervisorError, OSError) as error:
        return error


def _told(result: Outcome | Exception) -> tuple[str, str]:
    if isinstance(result, Exception):
        return "FAILED", ""  # why is told once, at the end: `SomeFailed`
    lines = (" ".join(line.split()) for line in result.text.splitlines())
    return ("in doubt" if result.doubt else "done"), ", ".join(filter(None, lines))


def _data(member: GroupMember, result: Outcome | Exception) -> dict[str, Any]:
    if isinstance(result, Exception):
        return {"name": member.name, "ok": False, "error": type(result).__name__, "detail": sentence(result)}
    return {"name": member.name, "ok": True, "result": result.data}


# -- made and shown ----------------------------------------------------------------------------------


async def groups(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """List the groups, or show the members of one."""
    if name := line.text("GROUP"):
        return await _shown(realm_client, realm_client.groups.find(name))
    found = realm_client.groups.all()
    broken = [name for name in realm_client.groups.names() if name not in found]
    rows = [("GROUP", "MEMBERS"), *((one.name, one.about) for one in found.values())]
    rows += [(name, "cannot be read; make it anew") for name in broken]
    data = [{"name": one.name, "names": list(one.names), "where": one.rule} for one in found.values()]
    return Outcome(data, wording.columns(rows) if rows[1:] else "there is no group")


async def group(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Make a group, or delete one; with nothing but its name, show it."""
    from robotree.vr.base.errors import DuplicateName
    from robotree.vr.base.group import RobotGroup
    from robotree.vr.scripts.requirement import member_rule

    name, names = line.text("GROUP"), line.many("ROBOT")
    rule = _rule(line.text("--where"), line.text("--near"))
    if line.flag("--delete"):
        if names or rule:
            raise BadLine("a group is made or deleted, not both", "")
        realm_client.groups.delete(name)
        return Outcome({"deleted": name}, f"group {name} is deleted; its robots stay as they are")
    if not names and not rule:
        return await _shown(realm_client, realm_client.groups.find(name))
    if realm_client.directory.present("robot", name):
        raise DuplicateName(role="robot", name=name)
    made = RobotGroup(name=name, names=tuple(dict.fromkeys(names)), rule=rule)
    member_rule(made, realm_client.groups.find)  # its rule must be understood before it is kept
    realm_client.groups.write(made)
    return await _shown(realm_client, made)


def _rule(where: str, near: str) -> str:
    from robotree.vr.base.group import rule_of

    if '"' in near or "'" in near:
        raise ValueRefused("PLACE", f"{near!r} cannot be the name of a place")
    return rule_of(where, near)


async def _shown(realm_client: RealmClient, group: RobotGroup) -> Outcome:
    from robotree.vr.supervision.groups import members_of

    members = await members_of(realm_client, group)
    rows = [(f"  {one.name}", _kind(one), _state(one), one.why) for one in members]
    head = f"group {group.name}: {group.about}"
    names = ("name", "kind", "state", "why")
    known = [dict(zip(names, (row[0].strip(), *row[1:]), strict=True)) for row in rows]
    data = {"name": group.name, "names": list(group.names), "where": group.rule, "members": known}
    return Outcome(data, f"{head}\n{wording.columns(rows)}" if rows else f"{head}\n  nobody is in it now")


def _kind(member: GroupMember) -> str:
    return member.robot.kind if member.robot else "-"


def _state(member: GroupMember) -> str:
    if member.robot is not None:
        return status.text(member.robot)
    return "does not answer" if member.there else "away"
