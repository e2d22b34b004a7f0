"""The letters of a filter: words that must hold, `!` before one that must not, `kind:` and the like. Pure.

arm              rows that have these letters anywhere
!rover           rows that have not
state:stopped    rows whose state has these letters; also name: kind: by: host:
~am1             rows whose name has these letters in this order, with others between them (arm-1)
re:^arm-[12]$    rows in which this regular expression is found; also name:re:… and the like
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

FIELDS = ("name", "kind", "state", "by", "host")
"""The fields that a filter can name."""
EXPRESSION = "re:"
"""Before a regular expression."""
LONGEST = 80
"""Characters of an expression, and of a text in which it is looked for."""
REPEATS = 3
"""Repetitions and choices (`|`) in an expression, at most: the time of a search grows with their number."""
ENDLESS = 2
"""Of them such as may go on to the end of the text (`*`, `+`, `{`): each takes `LONGEST` times as long."""


@dataclass(frozen=True, slots=True)
class Term:
    """One word of a filter."""

    letters: str
    field: str = ""
    """Where the letters must be; empty: anywhere."""
    negative: bool = False
    fuzzy: bool = False
    """Other letters may stand between these."""
    expression: bool = False
    """They are a regular expression."""


def terms(text: str) -> tuple[Term, ...]:
    """Read a filter. A word that is not complete yet (`!`, `kind:`) asks for nothing."""
    found: list[Term] = []
    for word in text.split():
        negative, letters = word.startswith("!"), word.removeprefix("!")
        field, colon, rest = letters.partition(":")
        if colon and field.lower() in FIELDS:
            field, letters = field.lower(), rest
        else:
            field = ""
        if letters.startswith(EXPRESSION):
            letters = letters.removeprefix(EXPRESSION)
            if letters and not fault(letters):
                found.append(Term(letters, field, negative, expression=True))
            continue
        fuzzy, letters = letters.startswith("~"), letters.removeprefix("~").lower()
        if letters:
            found.append(Term(letters, field or ("name" if fuzzy else ""), negative, fuzzy))
    return tuple(found)


@lru_cache(maxsize=256)
def fault(expression: str) -> str:
    """Return why a regular expression asks for nothing, in a few words; empty: it is one.

    A repetition of what has repetitions, and many of them, could take longer than anybody lives; the screen
    with its stop would wait for it.
    """
    try:
        re.compile(expression)
    except re.error as error:
        return f"no regular expression: {error.msg}"
    if len(expression) > LONGEST:
        return f"longer than {LONGEST} characters"
    if re.search(r"\)[*+?{]", expression):
        return "a group cannot be repeated"
    if re.search(r"\\[1-9]|\(\?", expression):
        return "only plain groups, and nothing that names one, can be used"
    if len(re.findall(r"[*+?{|]", expression)) > REPEATS or len(re.findall(r"[*+{]", expression)) > ENDLESS:
        return f"more than {ENDLESS} of * + {{ or more than {REPEATS} of them with ? and |"
    return ""


def faults(text: str) -> tuple[str, ...]:
    """Return what is wrong with the expressions of a filter, for people."""
    words = (word.removeprefix("!") for word in text.split())
    found = (word.partition(EXPRESSION)[2] for word in words if EXPRESSION in word)
    return tuple(f"{one}: {why}" for one in found if one and (why := fault(one)))


@lru_cache(maxsize=64)
def _compiled(expression: str) -> re.Pattern[str]:
    return re.compile(expression, re.IGNORECASE)


def matches(wanted: Sequence[Term], said: Mapping[str, str]) -> bool:
    """Whether all terms hold.

    Args:
        wanted: the terms.
        said: text by field; other keys than `FIELDS` are only looked at by words without a field.
    """
    return all(_holds(term, said) for term in wanted)


def _holds(term: Term, said: Mapping[str, str]) -> bool:
    texts = [said.get(term.field, "")] if term.field else said.values()
    return any(_found(term, text) for text in texts) != term.negative


def _found(term: Term, text: str) -> bool:
    if term.expression:
        pattern = _compiled(term.letters)
        return any(pattern.search(line[:LONGEST]) for line in text.splitlines() or [""])
    if term.fuzzy:
        rest = iter(text.lower())
        return all(letter in rest for letter in term.letters)
    return term.letters in text.lower()
