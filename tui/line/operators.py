"""The verbs of several operators: who is here, control of robots, and a line to the others."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any, Literal, cast

from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller
from robotree.tui.seen import wording

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

FOR_A_SHELL = 600.0
"""[s] for which a line of a shell gets control, whose program ends at once."""


async def who(realm_client: RealmClient, _line: Line, _teller: Teller) -> Outcome:
    """List the operators who are here, and who has control of which robots."""
    here, tree = await asyncio.gather(realm_client.operators.ask(), realm_client.tree())
    held = [robot for robot in tree if robot.operator]
    data = {
        "operators": [
            {"person": each.person, "page": each.page, "robot": each.robot, "since": each.since}
            for each in here
        ],
        "silent_sites": list(realm_client.operators.silent),
        "control": [
            {
                "robot": robot.name,
                "operator": robot.operator,
                "since": robot.operator_since,
                "wanted_by": robot.wanted_by,
                "offered_to": robot.offered_to,
            }
            for robot in held
        ],
    }
    rows = [("OPERATOR", "SINCE", "PAGE")]
    rows += [(each.person, _clock(each.since), each.page or "-") for each in here]
    robots = [("ROBOT", "CONTROL", "SINCE", "")]
    robots += [(robot.name, robot.operator, _clock(robot.operator_since), _wish(robot)) for robot in held]
    first = wording.columns(rows) if here else "nobody has the full screen open"
    if silent := realm_client.operators.silent:
        first += f"\nnot heard, so who sits there is not known: {', '.join(silent)}"
    second = wording.columns(robots) if held else "nobody has control of a robot: all may command it"
    return Outcome(data, f"{first}\n\n{second}")


def _wish(robot: RobotDescription) -> str:
    wanted = f"{robot.wanted_by} asks for it" if robot.wanted_by else ""
    return wanted or (f"offered to {robot.offered_to}" if robot.offered_to else "")


async def say(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Say a line to all operators."""
    text = " ".join(line.many("TEXT"))
    said = await realm_client.operators.say(text)
    warning = "" if said.heard else "nobody else has the full screen open"
    if said.silent:
        warning = f"not confirmed by {', '.join(said.silent)}: a program that hangs, or an older robotree"
    return Outcome({"said": text, "heard": said.heard, "silent": list(said.silent)}, warning)


async def control(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Get, ask for, offer, take or leave control of a robot; the second word of the verb says which."""
    what = cast('Literal["get", "ask", "offer", "take", "leave"]', line.verb.removeprefix("control "))
    name, person = line.text("NAME"), line.text("PERSON")
    within = values.duration(line.text("--for")) if line.text("--for") else 0.0
    if not within and what in {"get", "ask", "take"} and getattr(teller, "ends_at_once", False):
        within = FOR_A_SHELL
    seen = -1
    if what == "take":
        seen = (
            (await realm_client.describe(name)).hands if not line.text("--seen") else int(line.text("--seen"))
        )
    holder = await realm_client.control(name, what, person=person, within=within, seen=seen)
    data: dict[str, Any] = {"robot": name, "operator": holder}
    match what:
        case "ask":
            text = f"{holder} is asked for control of {name}, for 30 s"
        case "offer" if person and holder != person:
            text = f"control of {name} is offered to {person}, for 30 s"
        case "leave" if not holder:
            text = f"nobody has control of {name} now"
        case _:
            text = f"{holder} has control of {name}" + (f" for {_lasting(within)}" if within else "")
    return Outcome(data, text)


def _lasting(seconds: float) -> str:
    """Write a time in the largest unit that says it exactly: `1 h`, `90 min`, `45 s`."""
    unit, length = next(
        (each for each in (("h", 3600.0), ("min", 60.0)) if seconds % each[1] == 0), ("s", 1.0)
    )
    return f"{seconds / length:g} {unit}"


def _clock(unix: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(unix))
