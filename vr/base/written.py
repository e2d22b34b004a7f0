"""YAML as it was written: plain values that know their line and column, and no value that YAML invents.

Only what people type by hand is read: mappings, lists and single values. A single value stays the text that
was written (`no`, `0123` and `12:30` are texts); `value_of` reads numbers and yes/no where they are wanted.
Anchors, aliases, tags and a second document are refused: they are what YAML is attacked with. Pure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Protocol

import msgspec
import yaml

from robotree.vr.base.errors import BrokenScript

DEEPEST = 16
"""Levels of nesting."""

Scalar = bool | int | float | str


class Mark(msgspec.Struct, frozen=True):
    """Where something stands in a file, both counted from 1."""

    path: str = ""
    line: int = 0
    column: int = 0

    def error(self, reason: str) -> BrokenScript:
        """Return the error for a mistake at this place."""
        return BrokenScript(path=self.path, line=self.line, column=self.column, reason=reason)


class Word(msgspec.Struct, frozen=True):
    """One single value."""

    text: str
    mark: Mark
    quoted: bool = False

    @property
    def empty(self) -> bool:
        """Whether nothing is written there, as in `name:` alone."""
        return not self.text and not self.quoted


class Items(msgspec.Struct, frozen=True):
    """A list."""

    items: tuple[Written, ...]
    mark: Mark


class Entries(msgspec.Struct, frozen=True):
    """A mapping, in the order written."""

    entries: tuple[tuple[Word, Written], ...]
    mark: Mark

    def __iter__(self) -> Iterator[tuple[Word, Written]]:
        return iter(self.entries)

    def get(self, name: str) -> Written | None:
        """Return the value of a key, or None."""
        return next((value for key, value in self.entries if key.text == name), None)

    def text(self, name: str) -> str:
        """Return the single value of a key; empty: it is not there."""
        return word(self.get(name) or Word("", self.mark), name, self.mark).text

    def texts(self, name: str, what: str) -> tuple[str, ...]:
        """Return the single values of a key's list, each of which is called `what` in errors."""
        return tuple(word(one, what, self.mark).text for one in items(self.get(name), self.mark).items)

    def named_texts(self, name: str, what: str) -> dict[str, str]:
        """Return the single values of a key's mapping, as they were written; `what` as in `texts`."""
        found = entries(self.get(name), name, self.mark)
        return {key.text: word(given, what, key.mark).text for key, given in found}

    def named_values(self, name: str, what: str) -> dict[str, Scalar]:
        """Return the single values of a key's mapping, as they are meant; `what` as in `texts`."""
        found = entries(self.get(name), name, self.mark)
        return {key.text: value_of(word(given, what, key.mark)) for key, given in found}

    def expect(self, known: Sequence[str], what: str) -> None:
        """Refuse keys that `what` does not have."""
        for key, _ in self.entries:
            if key.text not in known:
                hint = suggestion(key.text, known)
                raise key.mark.error(f"{what} has no {key.text!r}{hint}; it has: {', '.join(known)}")


def suggestion(text: str, known: Iterable[str]) -> str:
    """Return ` (did you mean 'page'?)` where a word is nearly one that is known; else nothing."""
    near = get_close_matches(text, known, n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


Written = Word | Items | Entries

_NUMBER = re.compile(r"[-+]?(\d+|\d*\.\d+|\d+\.\d*)([eE][-+]?\d+)?\Z")
_TRUTH = {"yes": True, "true": True, "no": False, "false": False}
_UNFIT = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)
_TAB = "a tab cannot indent here: use spaces"
_SECOND = "a second document begins here: one file holds one"
_PROBLEMS = {
    "found a tab character that violates indentation": _TAB,
    "mapping values are not allowed in this context": "a second ':' in one line: put the text into quotes, "
    "or the value on its own line",
}


def read(source: str, path: str) -> Written:
    """Read one document, which its author keeps at `path`.

    Raises:
        BrokenScript: it cannot be read, and where.
    """
    for number, line in enumerate(source.split("\n"), 1):
        if found := _UNFIT.search(line.removesuffix("\r")):
            mark = Mark(path, number, found.start() + 1)
            raise mark.error(
                f"the invisible character U+{ord(found.group()):04X} cannot stand here: remove it"
            )
        indent = line[: len(line) - len(line.lstrip())]
        if "\t" in indent and line.strip():
            raise Mark(path, number, indent.index("\t") + 1).error(_TAB)
    events = yaml.parse(source, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    try:
        return _document(events, path)
    except yaml.MarkedYAMLError as error:
        raise _mark(path, error.problem_mark).error(_said(error)) from None
    except (yaml.YAMLError, ValueError) as error:
        raise Mark(path, 1, 1).error(f"this is no YAML: {error}") from None


def _document(events: Iterator[yaml.Event], path: str) -> Written:
    """Return the one document of a file, read from its events: libyaml's own tree overflows the stack."""
    root: Written | None = None
    for event in events:
        if isinstance(event, yaml.DocumentStartEvent):
            if root is not None:
                raise _mark(path, event.start_mark).error(_SECOND)
            root = _written(next(events), events, path, 0)
    if root is None:
        raise Mark(path, 1, 1).error("the file is empty")
    return root


def _said(error: yaml.MarkedYAMLError) -> str:
    problem = str(error.problem or error)
    if "that cannot start any token" in problem:
        return "a value cannot begin with @, `, % or a tab: put it into quotes, or use spaces"
    context = f" ({error.context})" if error.context else ""
    return _PROBLEMS.get(problem, f"this is no YAML: {problem}{context}")


class _Place(Protocol):
    """A mark of PyYAML: libyaml's and its own are two classes."""

    @property
    def line(self) -> int: ...
    @property
    def column(self) -> int: ...


def _mark(path: str, mark: _Place | None) -> Mark:
    return Mark(path, 1, 1) if mark is None else Mark(path, mark.line + 1, mark.column + 1)


def _written(event: yaml.Event, events: Iterator[yaml.Event], path: str, depth: int) -> Written:
    """Return what begins with an event; the events up to its end are taken from the others."""
    mark = _mark(path, event.start_mark)
    if isinstance(event, yaml.AliasEvent):
        raise mark.error("an alias (*) cannot be used: write it out")
    if depth > DEEPEST:
        raise mark.error(f"this is nested more than {DEEPEST} levels deep")
    if getattr(event, "tag", None):
        raise mark.error("a tag (!) cannot be used")
    if isinstance(event, yaml.ScalarEvent):
        return Word(str(event.value), mark, event.style in {"'", '"', "|", ">"})
    parts = (_written(part, events, path, depth + 1) for part in _until_end(events))
    if isinstance(event, yaml.SequenceStartEvent):
        return Items(tuple(parts), mark)
    entries: list[tuple[Word, Written]] = []
    known: set[str] = set()
    for name in parts:
        if not isinstance(name, Word):
            raise name.mark.error("a key must be one word")
        if name.text in known:
            raise name.mark.error(f"{name.text!r} stands here twice")
        known.add(name.text)
        entries.append((name, next(parts)))
    return Entries(tuple(entries), mark)


def _until_end(events: Iterator[yaml.Event]) -> Iterator[yaml.Event]:
    """Yield the first event of each part of a list or mapping."""
    for event in events:
        if isinstance(event, yaml.CollectionEndEvent):
            return
        yield event


def value_of(word: Word) -> Scalar:
    """Return a single value as it is meant: a number, yes or no, else text. What is in quotes is text."""
    if word.quoted:
        return word.text
    if word.text.lower() in _TRUTH:
        return _TRUTH[word.text.lower()]
    if _NUMBER.match(word.text):
        number, whole = float(word.text), word.text.lstrip("+-").isdigit()
        if math.isinf(number) or (whole and (len(word.text) > 20 or abs(int(word.text)) >= 2**63)):
            raise word.mark.error(f"{word.text[:24]}{'…' * (len(word.text) > 24)} is too large a number")
        return int(word.text) if whole else number
    return word.text


def entries(thing: Written | None, what: str, where: Mark) -> Entries:
    """Return a mapping; nothing at all is an empty one.

    Raises:
        BrokenScript: it is something else.
    """
    if thing is None or (isinstance(thing, Word) and thing.empty):
        return Entries((), where)
    if not isinstance(thing, Entries):
        raise thing.mark.error(f"{what} must be written as `name: value`")
    return thing


def items(thing: Written | None, where: Mark) -> Items:
    """Return a list; a single thing is a list of one, nothing at all an empty one."""
    if thing is None or (isinstance(thing, Word) and thing.empty):
        return Items((), where)
    return thing if isinstance(thing, Items) else Items((thing,), thing.mark)


def word(thing: Written | None, what: str, where: Mark) -> Word:
    """Return a single value.

    Raises:
        BrokenScript: it is something else, or missing.
    """
    if thing is None:
        raise where.error(f"{what} is missing")
    if not isinstance(thing, Word):
        raise thing.mark.error(f"{what} must be one value")
    return thing
