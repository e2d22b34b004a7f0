"""Facts as the conditions of their script are written, so that people read one language. Pure."""

from __future__ import annotations

from robotree.vr.base.errors import BrokenScript
from robotree.vr.base.written import Scalar
from robotree.vr.scripts.expression import Form, read, value
from robotree.vr.scripts.happening import spell
from robotree.vr.scripts.program import MESSAGE, PARAMETER, Program
from robotree.vr.scripts.when_then import EVENTS

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
        names = [name for name in EVENTS[kind] if name not in {"partner", "conversation"}]
        told = {"partner": sender} if "partner" in EVENTS[kind] else {}
        told |= {name: [one] for name, one in zip(names, given, strict=False)}
    else:
        kind = "message"
        told = {"from": sender, "performative": slots["perf"], "act": [act], "arguments": args}
    return kind, told if conversation == ["none"] else {**told, "conversation": conversation}


def _value(values: list[Scalar]) -> str:
    return spell(values[0]) if len(values) == 1 else f"[{', '.join(map(spell, values))}]"
