"""Tells why a rule fired, or why it does not fire, in the words of its script. No threads, no robots."""

from __future__ import annotations

from robotree.vr.base.errors import BrokenScript
from robotree.vr.base.written import Scalar
from robotree.vr.scripts.engine import Engine, Firing
from robotree.vr.scripts.expression import Form, read, value
from robotree.vr.scripts.happening import nearest, order_line, spell
from robotree.vr.scripts.program import MESSAGE, PARAMETER, Condition, Program, Rule
from robotree.vr.scripts.when_then import EVENTS, values_of

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
    lines += [f"  {in_words(fact, engine.program)}" for fact in facts[-MOST:]]
    agenda = engine.agenda()
    lines += [f"next ({len(agenda)}):", *(f"  {one}" for one in agenda[:MOST])]
    latest = list(engine.firings)[-LATEST:]
    lines += [f"fired ({engine.fired}):", *(f"  {one.number}: {one.rule}" for one in latest)]
    return "\n".join(lines)


def why(engine: Engine, name: str) -> str:
    """Tell why a rule fired last, or why it does not fire; without a name, which rules fired last."""
    if not name:
        latest = list(engine.firings)[-LATEST:]
        sentence = (
            f"{one.number}: {one.rule}" + "".join(f"\n    {order_line(order)}" for order in one.orders)
            for one in latest
        )
        return "\n".join(sentence) or "no rule has fired"
    rule = engine.program.rule(name)
    if rule is None:
        return unknown_rule(engine.program, name)
    fired = next((firing for firing in reversed(engine.firings) if firing.rule == name), None)
    lines: list[str] = []
    if fired is not None:
        lines.append(f"{name} fired last at happening {fired.number} of {engine.happened}, because of")
        lines += [f"  {one}" for one in _because(fired, rule, engine.program)]
        lines += [f"  → {order_line(order)}" for order in fired.orders]
    return "\n".join([*lines, *_why_not(engine, rule, fired)])


def unknown_rule(program: Program, name: str) -> str:
    """Return the sentence about the name of a rule that a script does not have."""
    known = [rule.name for rule in program.rules]
    hint = nearest(name, known) or f"; there are: {', '.join(known)}"
    return f"there is no rule {name!r}{hint}"


def _because(fired: Firing, rule: Rule, program: Program) -> list[str]:
    """Return the facts that met the conditions of a rule; for the others, what was not there."""
    absent = [_words(condition, program) for condition in rule.conditions if condition.negated]
    if len(absent) != fired.because.count("*"):
        absent = ["what must not be there is not"] * fired.because.count("*")
    given = iter(absent)
    facts = (one.partition(" ")[2] if one.startswith("f-") else one for one in fired.because)
    return [next(given) if fact == "*" else in_words(fact, program) for fact in facts if fact]


def _why_not(engine: Engine, rule: Rule, fired: Firing | None) -> list[str]:
    """Return which conditions of a rule lack which facts, in lines."""
    lines = engine.matches(rule.name)  # of each pattern alone, and of the first two, three … together
    counts = [(line.partition(" ")[0], line.rpartition(" ")[2] != "0") for line in lines]
    alone, together = ([fits for head, fits in counts if head == sort] for sort in ("Pattern", "CEs"))
    wanted = [condition for condition in rule.conditions if condition.template]
    lacks = [
        (one, lack)
        for at, (one, fits) in enumerate(zip(wanted, alone, strict=False))
        if (lack := _lack(engine, one, fits=fits, first=not at))
    ]
    tests = [condition for condition in rule.conditions if not condition.template]
    if len(alone) != len(wanted):  # CLIPS has made several rules of it, or nested conditions
        lacks = [(one, "this, or another condition, is not met") for one in wanted[:1]]
    elif not lacks and not all(together):
        at = together.index(False) + 1
        one, above = wanted[at], [other for other in wanted[:at] if other.template != PARAMETER]
        lack = "no fact fits this together with the conditions above it"
        if one.negated or not above:
            lack = _lack(engine, one, fits=one.negated, first=True)
        lacks = [(one, f"{lack}{'; or an `if` is not true' if tests else ''}")]
    elif not lacks and tests and fired is None:
        lacks = [(test, "this is not true") for test in tests[:1]]
    if not lacks:
        return [f"{rule.name} has fired for all that fits, or waits for its turn"]
    lines = [f"{rule.name} does not fire now:"]
    for one, lack in lacks:
        lines += [f"  line {one.mark.line}: {_words(one, engine.program)}", f"    {lack}"]
    return lines


def _lack(engine: Engine, condition: Condition, *, fits: bool, first: bool) -> str:
    """Return what keeps one condition from being met by itself; empty: nothing does."""
    if condition.negated:
        certain = first or "?" not in condition.text
        return "there is such a fact, and there must be none" if fits and certain else ""
    if fits or condition.template == PARAMETER:
        return ""
    if condition.template == MESSAGE:
        return "this has not just happened"
    facts = [fact for fact in engine.facts() if fact.startswith(f"({condition.template} ")]
    if not facts:
        return f"there is no fact {condition.template}"
    equal = [
        sum(
            f"({slot} {text})" in fact or f'({slot} "{text}")' in fact
            for slot, text in condition.wanted.items()
        )
        for fact in facts
    ]
    nearest = max(range(len(facts)), key=lambda at: (equal[at], at))
    return f"no fact fits; the nearest is {in_words(facts[nearest], engine.program)}"


def _words(condition: Condition, program: Program) -> str:
    """Return a condition as its author wrote it."""
    if program.for_experts:
        return f"(not {condition.text})" if condition.negated else condition.text
    line = program.source.splitlines()[condition.mark.line - 1]
    return line.strip().removeprefix("- ")


FactSlots = dict[str, list[Scalar]]


def parts(fact: str) -> tuple[str, FactSlots]:
    """Return the kind of a fact and the values of its slots.

    Args:
        fact: as CLIPS writes it: `(visitor (id Anna) (stage served))`.

    Raises:
        BrokenScript: it holds characters that no text may hold.
    """
    (tree,) = read(fact, "fact")
    slots = (slot for slot in tree.rest if isinstance(slot, Form))
    return tree.head, {slot.head: [value(one) for one in slot.rest] for slot in slots}


def in_words(fact: str, program: Program) -> str:
    """Return a fact of CLIPS in the words of its script: `visitor: {id: Anna, stage: served}`."""
    if program.for_experts:
        return fact
    try:
        kind, slots = parts(fact)
    except BrokenScript:
        return fact
    if kind == MESSAGE:
        kind, slots = _happening(slots, program)
    elif kind == PARAMETER:
        kind, slots = "parameters", {str(slots["name"][0]): slots["value"]}
    told = ", ".join(f"{name}: {_value(values)}" for name, values in slots.items())
    return f"{kind}: {{{told}}}" if told else kind


def _happening(slots: FactSlots, program: Program) -> tuple[str, FactSlots]:
    """Return what has happened by the names that conditions give it."""
    (act,), sender, args, conversation = slots["act"], slots["from"], slots["args"], slots["conv"]
    kind = "failed" if slots["perf"] == ["failure"] else str(act)
    heard = next((hear for hear in program.hears if hear.name == kind), None)
    told: FactSlots = {}
    if heard is not None:
        told = {name: [one] for (name, _), one in zip(heard.parts, args, strict=False)} | {"from": sender}
    elif kind in EVENTS:
        given = [act, *args] if kind == "failed" else args
        told = {"partner": sender} if "partner" in EVENTS[kind] else {}
        told |= {name: [one] for name, one in zip(values_of(kind), given, strict=False)}
    else:
        kind = "message"
        told = {"from": sender, "performative": slots["perf"], "act": [act], "arguments": args}
    return kind, told if conversation == ["none"] else {**told, "conversation": conversation}


def _value(values: list[Scalar]) -> str:
    return spell(values[0]) if len(values) == 1 else f"[{', '.join(map(spell, values))}]"
