"""The verb about questions: what scripts and interrupted commands ask people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller
from robotree.tui.seen.asked import questions_of

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.supervision.realm_client import RealmClient


async def questions(realm_client: RealmClient, _line: Line, _teller: Teller) -> Outcome:
    """List what is asked, with how it is answered."""
    found = [each for robot in await realm_client.tree() for each in questions_of(robot)]
    lines = [f"{one.robot}: {one.text}\n  robotree decide {one.robot} {one.how}" for one in found]
    data: list[dict[str, Any]] = [
        {"robot": one.robot, "question": one.text, "id": one.id, "answers": list(one.answers)}
        for one in found
    ]
    return Outcome(data, "\n".join(lines) or "nobody asks anything")
