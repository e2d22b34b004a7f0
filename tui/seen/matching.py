"""The letters of a filter: words that must hold, `!` before one that must not, `kind:` and the like. Pure.

arm              rows that have these letters anywhere
!rover           rows that have not
state:stopped    rows whose state has these letters; also name: kind: by: host:
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

FIELDS = ("name", "kind", "state", "by", "host")
"""The fields that a filter can name."""


@dataclass(frozen=True, slots=True)
class Term:
    """One word of a filter."""

    letters: str
    field: str = ""
    """Where the letters must be; empty: anywhere."""
    negative: bool = False


def terms(text: str) -> tuple[Term, ...]:
    """Read a filter. A word that is not complete yet (`!`, `kind:`) asks for nothing."""
    found: list[Term] = []
    for word in text.lower().split():
        negative, letters = word.startswith("!"), word.removeprefix("!")
        field, colon, rest = letters.partition(":")
        if colon and field in FIELDS:
            letters = rest
        else:
            field = ""
        if letters:
            found.append(Term(letters, field, negative))
    return tuple(found)


def matches(wanted: Sequence[Term], said: Mapping[str, str]) -> bool:
    """Whether all terms hold.

    Args:
        wanted: the terms.
        said: text by field; other keys than `FIELDS` are only looked at by words without a field.
    """
    return all(_holds(term, said) for term in wanted)


def _holds(term: Term, said: Mapping[str, str]) -> bool:
    texts = [said.get(term.field, "")] if term.field else said.values()
    return any(term.letters in text.lower() for text in texts) != term.negative
