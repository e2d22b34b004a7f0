"""The inputs and outputs of a script: plain values. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches

import msgspec

from robotree.vr.base.written import Scalar
from robotree.vr.scripts.expression import is_word

_TIME = re.compile(r"(\d+\.?\d*|\.\d+) *(ms|s|min|h)?\Z")
_SECONDS = {"ms": 0.001, "s": 1.0, None: 1.0, "min": 60.0, "h": 3600.0}


class Happening(msgspec.Struct, frozen=True, kw_only=True):
    """Something that the rules are told: a message, the end of an act, a timer, a partner that goes."""

    act: str
    """A message's name, or `start`, `done`, `answer`, `answered`, `progress`, `lost`, `found`, `stopped`,
    `released`, `timer`; the act that failed."""
    performative: str = "inform"
    sender: str = "script"
    """A partner, name of a caller, or `script`."""
    arguments: tuple[Scalar, ...] = ()
    conversation: str = "none"
    reply_by: float = 0.0
    """[s] in which an answer is wanted; 0: none is."""
    partner: str = ""
    """Slot that has been filled or emptied, or whose robot was stopped or released."""
    robot: str = ""
    """The robot that is in it now; empty: none."""
    choices: tuple[tuple[str, str], ...] = ()
    """Of a robot that is found: arguments of its commands, and values that they take."""
    number: int = 0
    """Of the act that has ended; 0: none has."""
    key: str = ""
    """Of the call that brought it; empty: none did."""


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


class PersonAsked(msgspec.Struct, frozen=True, kw_only=True):
    """Put a question to a person; its answer comes as `answered`."""

    conversation: str
    question: str
    answers: tuple[str, ...] = ()
    """Those that there are; empty: any text."""


class LogLine(msgspec.Struct, frozen=True, kw_only=True):
    """Tell people something."""

    text: str


class ScriptEnd(msgspec.Struct, frozen=True, kw_only=True):
    """The script is over."""

    text: str = ""
    well: bool = True


ScriptOrder = Do | PersonAsked | ScriptReply | Wait | CancelAct | Play | LogLine | ScriptEnd


def order_line(order: ScriptOrder) -> str:
    """Write an order in one line, as tables of tests and dry runs show it."""
    match order:
        case Do(partner=partner, act=act, values=values, named=named):
            given = [*map(spell, values), *(f"{key}={spell(value)}" for key, value in named.items())]
            words = ["do", partner, act, *given]
        case ScriptReply(conversation=conversation, performative=performative, values=values):
            words = ["reply", conversation, performative, *map(spell, values)]
        case PersonAsked(question=question, answers=answers):
            words = ["ask", spell(question), *map(spell, answers)]
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


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a part of a sentence with the known name that is most like this one; empty: none is."""
    near = get_close_matches(name, [*known], n=1)
    return f"; do you mean {near[0]!r}?" if near else ""


def seconds_of(value: Scalar) -> float | None:
    """Read a time as it is written in a script, `5 s` or `2 min` or a number of seconds; None: it is none."""
    if isinstance(value, str):
        found = _TIME.match(value.strip())
        return None if found is None else float(found.group(1)) * _SECONDS[found.group(2)]
    return None if isinstance(value, bool) else float(value)


def spell(value: Scalar) -> str:
    """Write a value as it is typed."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}" if isinstance(value, float) else str(value)
    return value if is_word(value) else '"' + value.replace('"', '\\"') + '"'
