"""Completing a half-typed line from the verbs' shapes and the names of the realm. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from robotree.tui.actions import Where, shapes
from robotree.tui.grammar import Blank, Group, Part, Shape, Word


@dataclass(frozen=True, slots=True)
class Words:
    """What can be named at the moment, by the names that the blanks of the usages have."""

    blanks: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """For example NAME, CHILD, PARENT.SLOT, ROBOT.COMMAND, VIEW, HOST."""


def complete(text: str, words: Words) -> str | None:
    """Return the line with its last word completed.

    Args:
        text: what stands before the cursor.
        words: what can be named.

    Returns:
        A longer line that begins with `text`, or None when nothing fits.
    """
    *before, last = text.split(" ")
    found = next(
        (word for word in _candidates([word for word in before if word], words) if _fits(word, last)), None
    )
    return text + found[len(last) :] if found else None


def _fits(word: str, typed: str) -> bool:
    return bool(typed) and word.startswith(typed) and word != typed


def _candidates(before: list[str], words: Words) -> Sequence[str]:
    known = shapes(Where.PROMPT)
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
