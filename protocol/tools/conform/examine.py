"""Tries the rules one after the other."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from enum import StrEnum
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import LinkError, ProtocolError
from robotree.protocol.links.security import UNSIGNED
from robotree.protocol.messages import (
    Claim,
    ClaimStatus,
    Goal,
    GoalCancel,
    GoalStatus,
    Heartbeat,
    Mode,
    ModeKind,
    SetMode,
    fields_of,
)
from robotree.protocol.tools.conform.motions import KINDS, recognised
from robotree.protocol.tools.conform.rules import OBSERVED, RULES, Rule
from robotree.protocol.tools.conform.trial import NotTried, RuleBroken, Spoken, Trial

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Collection

    from robotree.protocol.links.security import LinkSecurity

SHOWN_KINDS = (Goal, GoalCancel, GoalStatus, SetMode, Mode, Claim, ClaimStatus)
"""Messages that rules are about; telemetry and heartbeats would hide them."""
SHOWN = 16
"""Frames that are shown of a rule that is broken."""


class NotExaminable(ProtocolError):
    """The controller must not be examined now, or cannot be: one sentence."""


class NotHeard(NotExaminable):
    """Nobody speaks there as a controller does."""


class Outcome(StrEnum):
    """How the trial of a rule ended."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_TRIED = "not tried"


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one rule."""

    rule: Rule
    outcome: Outcome
    detail: str = ""
    """How the controller broke the rule, or why the rule was not tried."""
    seconds: float
    """[s] that the trial took."""
    spoken: tuple[Spoken, ...] = ()
    """Of a rule that is broken: the last messages that matter."""


async def examine(
    url: str,
    *,
    kind: str = "",
    controller: tuple[int, int] = (1, 1),
    security: LinkSecurity = UNSIGNED,
    rules: Collection[str] = (),
) -> AsyncGenerator[Result]:
    """Try the rules at a running controller. Its robot moves.

    Args:
        url: of the controller.
        kind: one of `KINDS`; empty: it is recognised by its telemetry.
        controller: its system and component.
        security: signs the link.
        rules: ids of those to try; empty: all.

    Yields:
        A result for each rule.

    Raises:
        LinkError: it cannot be reached.
        NotExaminable: it says nothing, somebody else commands it, or it is stopped.
    """
    trial = Trial(url, controller=controller, motions=KINDS.get(kind), security=security)
    await trial.start()
    try:
        await _meet(trial, known=bool(kind))
        for rule in RULES.values():
            if not rules or rule.id in rules:
                yield await _tried(rule, trial)
        await trial.settle()
    except RuleBroken as error:
        raise NotExaminable(f"It was left as it is: {error}.") from error
    finally:
        trial.close()


async def _meet(trial: Trial, *, known: bool) -> None:
    """Listen until it is known who is there, and whether it may be moved."""
    try:
        await trial.line.expect(Heartbeat, within=OBSERVED)
        await trial.line.expect(Mode, within=OBSERVED)
    except RuleBroken as error:
        raise NotHeard(f"{trial.url}: {error}; is a controller of robotree's dialect there?") from error
    if not known:
        await asyncio.sleep(OBSERVED)
        kinds = {type(each.message) for each in trial.line.received}
        trial.motions = recognised(kinds, trial.controller[1])
    if trial.life:
        with suppress(RuleBroken):  # the rule `claim-status` is about this
            await trial.line.until(lambda: trial.claim is not None, OBSERVED, "CLAIM_STATUS")
    if trial.claim is not None and trial.claim.holder:
        holder = trial.claim.name or "another program"
        raise NotExaminable(f"{trial.url}: {holder} holds this controller; end it first")
    if trial.mode is not None and trial.mode.mode == ModeKind.SAFE_STOP:
        raise NotExaminable(f"{trial.url}: it is stopped; release the stop first (robotree resume)")


async def _tried(rule: Rule, trial: Trial) -> Result:
    began = trial.now()

    def result(outcome: Outcome, error: Exception | None = None) -> Result:
        spoken = _that_matters(trial) if outcome is Outcome.BROKEN else ()
        return Result(
            rule=rule, outcome=outcome, detail=str(error or ""), seconds=trial.now() - began, spoken=spoken
        )

    trial.spoken.clear()
    try:
        await trial.settle()
        trial.spoken.clear()
        await rule.check(trial)
    except NotTried as error:
        return result(Outcome.NOT_TRIED, error)
    except (RuleBroken, LinkError) as error:
        return result(Outcome.BROKEN, error)
    return result(Outcome.KEPT)


def _that_matters(trial: Trial) -> tuple[Spoken, ...]:
    """The last messages of a trial, without telemetry and without what says the same again."""
    found: list[Spoken] = []
    for each in trial.spoken:
        if not isinstance(each.message, SHOWN_KINDS):
            continue
        latest = next((one for one in reversed(found) if type(one.message) is type(each.message)), None)
        if latest is None or each.sent or not _same(latest, each):
            found.append(each)
    return tuple(found[-SHOWN:])


def _same(before: Spoken, after: Spoken) -> bool:
    """Whether two reports say the same, apart from their time."""
    first, second = (fields_of(each.message) | {"time_boot_ms": 0} for each in (before, after))
    return first == second
