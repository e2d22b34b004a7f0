"""Why a rule fired, and why it does not: in the words of the script. No threads, no robots."""

from __future__ import annotations

import re

from robotree.vr.scripts.engine import Engine
from robotree.vr.scripts.happening import said, spell
from robotree.vr.scripts.program import MESSAGE, Condition, Rule

MOST = 40
"""Lines of facts that are shown; the newest."""
LATEST = 12
"""Firings that are shown."""


def state(engine: Engine, condition: str = "") -> str:
    """Show facts and agenda."""
    facts = engine.facts()
    lines = [condition] if condition else []
    lines += [f"facts ({len(facts)}):"]
    lines += [f"  … {len(facts) - MOST} more"] if len(facts) > MOST else []
    lines += [f"  {fact}" for fact in facts[-MOST:]]
    agenda = engine.agenda()
    lines += [f"next ({len(agenda)}):", *(f"  {one}" for one in agenda[:MOST])]
    latest = list(engine.firings)[-LATEST:]
    lines += [f"fired ({engine.fired}):", *(f"  {one.number}: {one.rule}" for one in latest)]
    return "\n".join(lines)


def why(engine: Engine, name: str) -> str:
    """Tell why a rule fired last, or why it does not fire; without a name, which rules fired last."""
    if not name:
        latest = list(engine.firings)[-LATEST:]
        told = (
            f"{one.number}: {one.rule}" + "".join(f"\n    {said(order)}" for order in one.orders)
            for one in latest
        )
        return "\n".join(told) or "no rule has fired"
    rule = engine.program.rule(name)
    if rule is None:
        known = ", ".join(one.name for one in engine.program.rules)
        return f"there is no rule {name!r}; there are: {known}"
    fired = next((one for one in reversed(engine.firings) if one.rule == name), None)
    lines: list[str] = []
    if fired is not None:
        lines.append(f"{name} fired last at happening {fired.number} of {engine.happened}, because of")
        lines += [f"  {fact if fact != '*' else 'something that is not there'}" for fact in fired.because]
        lines += [f"  → {said(order)}" for order in fired.orders]
    return "\n".join([*lines, why_not(engine, rule)])


def why_not(engine: Engine, rule: Rule) -> str:
    """Tell which condition of a rule lacks which fact."""
    lines = [f"{rule.name} does not fire now:"]
    alone = True
    for condition in rule.conditions:
        told = _lack(engine, condition)
        if told:
            alone = False
            lines.append(f"  line {condition.mark.line}: {told}")
    if alone:
        together = _together(engine, rule)
        if together is None:
            return f"{rule.name} has fired for all that fits, or waits for its turn"
        lines.append(f"  {together}")
    return "\n".join(lines)


def _lack(engine: Engine, condition: Condition) -> str:
    """Return what keeps one condition from being met by itself; empty: nothing does."""
    facts = list(engine.facts_of(condition.template)) if condition.template else []
    fit = [slots for _, slots in facts if _fits(slots, condition)]
    if not condition.template or bool(fit) != condition.negated:
        return ""
    if condition.negated:
        return "" if "?" in condition.text else f"there is a fact {_words(condition)}, and there must be none"
    if condition.template == MESSAGE:
        return f"nothing has just happened that fits {_words(condition)}"
    return _nearest(facts, condition) if facts else f"there is no fact {condition.template}"


def _nearest(facts: list[tuple[int, dict[str, object]]], condition: Condition) -> str:
    def differences(slots: dict[str, object]) -> list[str]:
        return [
            f"{key} is {_text(slots.get(key))}, wanted {_text(value)}"
            for key, value in condition.wanted.items()
            if _text(slots.get(key)) != _text(value)
        ]

    number, slots = min(facts, key=lambda fact: len(differences(fact[1])))
    told = "; ".join(differences(slots)) or "other values"
    return f"no fact fits {_words(condition)}; the nearest is f-{number}: {told}"


def _fits(slots: dict[str, object], condition: Condition) -> bool:
    return all(_text(slots.get(key)) == _text(value) for key, value in condition.wanted.items())


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _words(condition: Condition) -> str:
    parts = [f"{key}: {spell(value)}" for key, value in condition.wanted.items()]
    return f"{condition.template} {{{', '.join(parts)}}}" if parts else condition.template


def _together(engine: Engine, rule: Rule) -> str | None:
    """Return which conditions do not fit together; None: they do, or there is only one."""
    last = 0
    for line, after in zip(lines := engine.matches(rule.name), [*lines[1:], ""], strict=False):
        found = re.match(r"Partial matches for CEs 1 - (\d+)", line.strip())
        if found and "None" in after:
            last = int(found.group(1))
            break
    if not last:
        return None
    return f"its conditions hold one by one, but no facts meet the first {last} together: see their variables"
