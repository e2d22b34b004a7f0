"""Completing a half-typed line from the verbs' shapes and the names of the realm. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile

from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.grammar import Blank, Group, Part, Shape, Word


@dataclass(frozen=True, slots=True)
class Words:
    """What can be named at the moment, by the names that the blanks of the usages have."""

    blanks: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """For example NAME, CHILD, PARENT.SLOT, ROBOT.COMMAND, VIEW, HOST."""
    verbs: Mapping[str, Shape] = field(default_factory=lambda: shapes(Where.PROMPT))
    """The verbs that are there."""


def candidates(text: str, words: Words) -> tuple[str, ...]:
    """Return the words that the last one may become.

    Args:
        text: what stands before the cursor; after a space every word that may come next fits.
        words: what can be named.

    Returns:
        The words, each once; what was typed in full already is none of them.
    """
    *before, last = text.split(" ")
    given = [word for word in before if word]
    if not (given or last):
        return ()
    return tuple(
        dict.fromkeys(word for word in _known(given, words) if word.startswith(last) and word != last)
    )


def complete(text: str, words: Words) -> str | None:
    """Return the line with its last word completed as far as there is no choice.

    Args:
        text: what stands before the cursor.
        words: what can be named.

    Returns:
        A longer line that begins with `text`, or None when nothing fits or more must be typed first.
    """
    last = text.rpartition(" ")[2]
    found = _shared(candidates(text, words))
    return text + found[len(last) :] if len(found) > len(last) else None


def _shared(words: Sequence[str]) -> str:
    """Return the letters with which all words begin: as far as the first and the last in order agree."""
    both = zip(min(words, default=""), max(words, default=""), strict=False)
    return "".join(one for one, _ in takewhile(lambda pair: pair[0] == pair[1], both))


def _known(before: list[str], words: Words) -> Sequence[str]:
    known = words.verbs
    if not before:
        return tuple(known)
    shape = known.get(before[0])
    if shape is None:
        return ()
    found: list[str] = []
    for part in _next_parts(shape, before[1:]):
        found += [part.text] if isinstance(part, Word) else words.blanks.get(part.name, ())
    return [*found, *(f"--{option}" for option in shape.options)]


def _next_parts(shape: Shape, given: list[str]) -> list[Word | Blank]:
    """Return the parts that may come after these words; options are left out of account."""
    flat = _flat(shape.parts)
    plain = [word for word in given if not word.startswith("--")]
    if len(plain) < len(flat):
        return flat[len(plain) : len(plain) + 1]
    last = flat[-1] if flat else None
    return [last] if isinstance(last, Blank) and last.repeated else []


def _flat(parts: Sequence[Part]) -> list[Word | Blank]:
    flat: list[Word | Blank] = []
    for part in parts:
        flat += _flat(part.parts) if isinstance(part, Group) else [part]
    return flat
