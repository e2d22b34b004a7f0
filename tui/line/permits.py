"""The verbs about what waits for a person: permits that assistants ask for, and questions of scripts."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.seen.asked import questions_of

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.errors import Denied
    from robotree.vr.base.permit import Permit
    from robotree.vr.network.permit_file import PermitFiles
    from robotree.vr.supervision.realm_client import RealmClient


def permits_of(realm_client: RealmClient) -> PermitFiles:
    """Return the permits of a realm."""
    from robotree.vr.network.permit_file import permits_beside

    return permits_beside(realm_client.gate)


async def permits(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """List the permits that wait for a person, or all that are remembered."""
    kept = permits_of(realm_client)
    found = kept.all() if line.flag("--all") else kept.waiting()
    text = "\n\n".join(permit_text(one, time.time(), str(kept.folder)) for one in found)
    return Outcome([plain(one) for one in found], text or "no permit waits for an answer")


async def permit_allow(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Say yes to one call of an assistant, unless it could not begin with it."""
    from robotree.vr.base.errors import PermitRefused

    found = permits_of(realm_client).find(line.text("PERMIT"))
    if found.state == "waits" and (reason := await voided(realm_client, found)):
        raise PermitRefused(permit=found.id, reason=f"{reason}; the assistant has to ask again")
    return _answered(realm_client, line.text("PERMIT"), yes=True)


async def permit_deny(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Say no to one call of an assistant."""
    return _answered(realm_client, line.text("PERMIT"), yes=False)


async def voided(realm_client: RealmClient, found: Permit) -> str:
    """Return why a yes would be of no use, as a clause: the robots are not as they were; empty: it would."""
    from robotree.vr.base.errors import VrError

    asked = {found.robot: (found.life, found.stops), **{one: tuple(was) for one, was in found.below.items()}}
    for name, (life, stops) in asked.items():
        if not life:
            continue  # it could not be asked then; the robot itself judges
        try:
            now = await realm_client.describe(name)
        except VrError as error:
            return f"{name} cannot be asked ({error})"
        if now.address.key != life:
            return f"{name} was started anew since it was asked for"
        if now.stops != stops:
            return f"{name} was stopped since it was asked for"
    return ""


def _answered(realm_client: RealmClient, permit: str, *, yes: bool) -> Outcome:
    done = answer(realm_client, permit, yes=yes)
    words = "may begin, once, within 5 min" if yes else "will not begin"
    data: dict[str, Any] = {"permit": done.id, "state": done.state, "call": done.call, "by": done.by}
    return Outcome(data, f"{done.call} {words}")


def answer(realm_client: RealmClient, permit: str, *, yes: bool) -> Permit:
    """Answer a permit as the person at this terminal, who must be allowed to command the robot itself.

    Raises:
        PermitError: it cannot be answered.
        Denied: this person may not.
    """
    from robotree.vr.base.envelope import this_terminal
    from robotree.vr.base.principal import user_name

    files = permits_of(realm_client)
    found = files.find(permit)
    if yes and (refused := refusal(realm_client, found)) is not None:
        raise refused
    return files.answer(permit, yes=yes, by=f"{user_name(os.geteuid())}@{this_terminal()}")


def refusal(realm_client: RealmClient, found: Permit) -> Denied | None:
    """Return why the person at this terminal may not say yes to a permit; None: that is allowed."""
    from robotree.vr.base.errors import Denied
    from robotree.vr.base.policy import PolicyTarget
    from robotree.vr.base.principal import user_name

    listed = [one for one in realm_client.robots() if one.address.key == found.life]
    kinds = tuple(listed[0].kinds) if listed else ()
    gate, user = realm_client.gate, user_name(os.geteuid())
    name, site = found.robot.rpartition(":")[2], realm_client.places.site_of(found.life) or gate.site
    target = PolicyTarget(name, "robot", kinds, found.command, site)
    decision = gate.may(gate.user(user), "command", target)
    if decision.allowed:
        return None
    who = gate.user(user).name
    return Denied(who=who, right="command", target=str(target), reason=decision.reason, ask=gate.ask)


def permit_text(permit: Permit, now: float, folder: str = "") -> str:
    """Return a permit for people: who wants what, why, and what it would do.

    Args:
        permit: which.
        now: [s] since 1970.
        folder: in which its picture lies.
    """
    lines = permit_portrait(permit, now)
    if permit.picture and folder:
        lines.append(f"  picture: {folder}/{permit.picture}")
    if permit.outcome:
        lines.append(f"  it ended: {permit.outcome}")
    if permit.state == "waits" and not permit.expired(now):
        lines.append(f"  robotree permit allow {permit.id}    or: robotree permit deny {permit.id}")
    return "\n".join(lines)


def permit_portrait(permit: Permit, now: float) -> list[str]:
    """Return what a person has to know of a permit before the answer, line by line [now in s since 1970]."""
    state = "has expired" if permit.state == "waits" and permit.expired(now) else permit.state
    lines = [f"{permit.id}  {permit.call}  within {permit.within:g} s", f"  {state}{_since(permit, now)}"]
    lines.append(f"  {permit.assistant} asks; it says why: «{permit.why}»")
    if permit.by:
        lines.append(
            f"  {permit.by} answered at {time.strftime('%H:%M:%S', time.localtime(permit.answered))}"
        )
    return lines + [f"  {line}" for line in permit.preview]


def _since(permit: Permit, now: float) -> str:
    if permit.state == "waits" and not permit.expired(now):
        return f" since {max(0.0, now - permit.asked):.0f} s, for {(permit.until() - now) / 60:.0f} min more"
    return f", asked at {time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(permit.asked))}"


# -- questions of scripts and of interrupted commands ----------------------------------------------


async def questions(realm_client: RealmClient, _line: Line, _teller: Teller) -> Outcome:
    """List what is asked, with how it is answered."""
    found = [each for robot in await realm_client.tree() for each in questions_of(robot)]
    lines = [f"{one.robot}: {one.text}\n  robotree decide {one.robot} {one.how}" for one in found]
    data: list[dict[str, Any]] = [
        {"robot": one.robot, "question": one.text, "id": one.id, "answers": list(one.answers)}
        for one in found
    ]
    return Outcome(data, "\n".join(lines) or "nobody asks anything")
