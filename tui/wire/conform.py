"""`robotree wire conform --connect URL`: does a controller keep the rules of docs/bring-your-own-robot.md?"""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any

import msgspec

from robotree.protocol.messages import fields_of
from robotree.protocol.tools.conform import KINDS, RULES, Level, Outcome, Result, examine
from robotree.protocol.tools.conform.trial import Spoken
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import note, put
from robotree.tui.wire.security import securing

WORDS = {Outcome.KEPT: "ok", Outcome.BROKEN: "BROKEN", Outcome.NOT_TRIED: "-"}


def conform(line: Line, _realm: str) -> int:
    """Try the rules, and print a line for each."""
    kind = line.text("--kind")
    if kind and kind not in KINDS:
        raise ValueRefused("KIND", f"{kind!r} is no kind that can be moved here; there is {', '.join(KINDS)}")
    refusal = "is no component; write a number from 1 to 255"
    component = values.whole("COMPONENT", line.text("--component", "1"), 1, 255, refusal)
    unknown = [each for each in line.many("RULE") if each not in RULES]
    if unknown:
        raise ValueRefused("RULE", f"{unknown[0]!r} is no rule; there is {', '.join(RULES)}")
    return asyncio.run(_conform(line, kind, (1, component)))


async def _conform(line: Line, kind: str, controller: tuple[int, int]) -> int:
    counts = Counter[tuple[Level, Outcome]]()
    as_json = line.flag("--json")
    moving = KINDS[kind].summary if kind else "a short way"
    note(f"the robot moves slowly ({moving}), for a minute: keep clear of it; Ctrl-C ends it")
    async with securing(line) as security:
        results = examine(
            line.text("--connect"),
            kind=kind,
            controller=controller,
            security=security,
            rules=line.many("RULE"),
        )
        async for result in results:
            counts[result.rule.level, result.outcome] += 1
            put(msgspec.json.encode(plain(result)).decode() if as_json else shown(result))
    broken = counts[Level.MUST, Outcome.BROKEN]
    if as_json:
        totals = {level: {outcome: counts[level, outcome] for outcome in Outcome} for level in Level}
        put(msgspec.json.encode({"totals": totals, "conforms": not broken}).decode())
    else:
        put(summary(counts))
    return exit_codes.REFUSED if broken else exit_codes.DONE


def shown(result: Result) -> str:
    """One line for people; below a broken rule what it did, and the frames."""
    rule = result.rule
    text = f"{rule.level:<6} {WORDS[result.outcome]:<6} {rule.id:<18} {rule.text}"
    if result.outcome is Outcome.NOT_TRIED:
        return f"{text} (not tried: {result.detail})"
    if result.outcome is Outcome.KEPT:
        return text
    return "\n".join([text, f"       {result.detail}", *map(_frame, result.spoken)])


def summary(counts: Counter[tuple[Level, Outcome]]) -> str:
    """The last line for people."""
    parts = [
        f"{level}: {counts[level, Outcome.KEPT]} kept, {counts[level, Outcome.BROKEN]} broken, "
        f"{counts[level, Outcome.NOT_TRIED]} not tried"
        for level in Level
    ]
    verdict = "it does not conform" if counts[Level.MUST, Outcome.BROKEN] else "it conforms"
    return f"{verdict}.  {'.  '.join(parts)}."


def plain(result: Result) -> dict[str, Any]:
    """One result as data."""
    return {
        "rule": result.rule.id,
        "level": result.rule.level,
        "outcome": result.outcome,
        "text": result.rule.text,
        "detail": result.detail,
        "seconds": round(result.seconds, 2),
        "frames": [
            {
                "at": round(each.at, 3),
                "sent": each.sent,
                "from": f"{each.system}/{each.component}",
                "name": each.message.codec.definition.name,
                "fields": fields_of(each.message),
            }
            for each in result.spoken
        ],
    }


def _frame(spoken: Spoken) -> str:
    name = spoken.message.codec.definition.name.removeprefix("ROBOTREE_")
    said = " ".join(
        f"{key}={value!s}" for key, value in fields_of(spoken.message).items() if value not in ("", 0)
    )
    return f"       {spoken.at:7.3f} s  {'──►' if spoken.sent else '◄──'} {name} {said}"
