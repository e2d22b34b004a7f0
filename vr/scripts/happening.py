"""What goes into a script and what comes out of it: plain values. Pure."""

from __future__ import annotations

import msgspec

from robotree.vr.base.written import Scalar
from robotree.vr.scripts.expression import is_word


class Happening(msgspec.Struct, frozen=True, kw_only=True):
    """Something that the rules are told: a message, the end of an act, a timer, a partner that goes."""

    act: str
    """A message's name, or `start`, `done`, `progress`, `lost`, `found`, `stopped`, `released`, `timer`; the
    act that failed."""
    performative: str = "inform"
    sender: str = "script"
    """Slot of a partner, name of a caller, or `script`."""
    arguments: tuple[Scalar, ...] = ()
    conversation: str = "none"
    reply_by: float = 0.0
    """[s] in which an answer is wanted; 0: none is."""
    partner: str = ""
    """Slot that has been filled or emptied, or whose robot was stopped or released."""
    robot: str = ""
    """Who is in it now; empty: nobody."""


class Do(msgspec.Struct, frozen=True, kw_only=True):
    """Have a partner do something."""

    conversation: str
    partner: str
    act: str
    values: tuple[Scalar, ...] = ()
    named: dict[str, Scalar] = {}


class ScriptReply(msgspec.Struct, frozen=True, kw_only=True):
    """Answer the sender."""

    conversation: str
    performative: str
    values: tuple[Scalar, ...] = ()


class Wait(msgspec.Struct, frozen=True, kw_only=True):
    """Tell the rules `timer NAME` after a time."""

    name: str
    seconds: float
    conversation: str = "none"


class CancelAct(msgspec.Struct, frozen=True, kw_only=True):
    """End acts: those of a conversation, or all of a partner."""

    what: str


class Play(msgspec.Struct, frozen=True, kw_only=True):
    """Give a partner another role."""

    partner: str
    role: str


class LogLine(msgspec.Struct, frozen=True, kw_only=True):
    """Tell people something."""

    text: str


class ScriptEnd(msgspec.Struct, frozen=True, kw_only=True):
    """The script is over."""

    text: str = ""
    well: bool = True


ScriptOrder = Do | ScriptReply | Wait | CancelAct | Play | LogLine | ScriptEnd


def order_line(order: ScriptOrder) -> str:
    """Write an order in one line, as tables of tests and dry runs show it."""
    match order:
        case Do(partner=partner, act=act, values=values, named=named):
            given = [*map(spell, values), *(f"{key}={spell(value)}" for key, value in named.items())]
            words = ["do", partner, act, *given]
        case ScriptReply(conversation=conversation, performative=performative, values=values):
            words = ["reply", conversation, performative, *map(spell, values)]
        case Wait(name=name, seconds=seconds):
            words = ["wait", name, f"{seconds:g}"]
        case CancelAct(what=what):
            words = ["cancel", what]
        case Play(partner=partner, role=role):
            words = ["role", partner, role]
        case LogLine(text=text):
            words = ["log", spell(text)]
        case ScriptEnd(text=text, well=well):
            words = ["end" if well else "fail", *([spell(text)] if text else [])]
    return " ".join(words)


def spell(value: Scalar) -> str:
    """Write a value as it is typed."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}" if isinstance(value, float) else str(value)
    return value if is_word(value) else '"' + value.replace('"', '\\"') + '"'
