"""The lines of a session script, before their values are known: blocks, tables and trials. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from robotree.tui.errors import SupervisorError
from robotree.tui.line import grammar

NAME = re.compile(r"[A-Za-z_]\w*")
"""Of a value."""

Complain = Callable[[int, str], None]
"""Told of a line that cannot be understood: its number, from 1, and why."""

MOST_ROWS = 1000
"""Of one table."""

OPENS = {"repeat", "within", "table", "finally"}
"""The first word of a line that ends with `end`; so does `on failure`."""


@dataclass(frozen=True, slots=True)
class RawLine:
    """One line in words, with the lines up to its `end`."""

    number: int
    words: tuple[str, ...]
    text: str
    body: tuple[RawLine, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of values, one run each."""

    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(slots=True)
class Part:
    """A trial, or what stands before the first one and belongs to each."""

    name: str
    number: int
    lines: list[RawLine] = field(default_factory=list[RawLine])
    tables: list[Table] = field(default_factory=list[Table])
    on_failure: list[RawLine] = field(default_factory=list[RawLine])
    at_end: list[RawLine] = field(default_factory=list[RawLine])


@dataclass(frozen=True, slots=True)
class Lines:
    """The lines of a whole script."""

    common: Part
    parts: tuple[Part, ...]
    """The trials; none: the script is one."""


def of_text(text: str, complain: Complain) -> Lines:
    """Cut a script at its trials and blocks."""
    rows = list(_words(text, complain))
    raw, rest = _until_end(rows, complain)
    while rest:
        complain(rest[0].number, "`end` ends nothing here")
        more, rest = _until_end(rest[1:], complain)
        raw += more
    common, parts = Part("", 0), list[Part]()
    for line in raw:
        if line.words[0] == "trial":
            parts.append(Part(_name(line, [part.name for part in parts], complain), line.number))
        else:
            _sort(line, parts[-1] if parts else common, complain)
    return Lines(common, tuple(parts))


def _words(text: str, complain: Complain) -> Iterator[RawLine]:
    for number, line in enumerate(text.splitlines(), 1):
        try:
            words = grammar.split(line)
        except SupervisorError as error:
            complain(number, str(error))
            continue
        if words:
            yield RawLine(number, words, line.strip())


def _opens(line: RawLine) -> bool:
    return line.words[0] in OPENS or line.words == ("on", "failure")


def _until_end(rows: Sequence[RawLine], complain: Complain) -> tuple[list[RawLine], list[RawLine]]:
    """Return the lines up to an `end` that belongs to none of them, and what begins with it."""
    found, rest = list[RawLine](), list(rows)
    while rest and rest[0].words != ("end",):
        line, *rest = rest
        if _opens(line):
            body, rest = _until_end(rest, complain)
            if rest:
                rest = rest[1:]
            else:
                complain(line.number, f"`{line.words[0]}` has no `end`")
            line = replace(line, body=tuple(body))
        found.append(line)
    return found, rest


def _sort(line: RawLine, part: Part, complain: Complain) -> None:
    match line.words:
        case ("table", *more):
            if more:
                complain(line.number, "`table` stands alone in its line; the names are in the next one")
            elif table := _table(line, complain):
                part.tables.append(table)
        case ("on", "failure"):
            part.on_failure += _plain(line.body, complain)
        case ("finally",):
            part.at_end += _plain(line.body, complain)
        case ("finally", *_):
            complain(line.number, "`finally` stands alone in its line")
        case _:
            part.lines += _plain((line,), complain)


def _plain(lines: Sequence[RawLine], complain: Complain) -> list[RawLine]:
    """Leave out, and complain about, what cannot be inside a block."""
    found = list[RawLine]()
    for line in lines:
        if line.words[0] in {"trial", "table", "finally"} or line.words == ("on", "failure"):
            complain(line.number, f"`{line.words[0]}` cannot stand inside a block")
        else:
            found.append(replace(line, body=tuple(_plain(line.body, complain))))
    return found


def _table(line: RawLine, complain: Complain) -> Table | None:
    names, *rows = [each.words for each in line.body] or [()]
    wrong = [name for name in names if not NAME.fullmatch(name)] or [
        name for name in names if names.count(name) > 1
    ]
    if not names or not rows:
        complain(line.number, "this table needs a line with names, and rows of values below it")
    elif wrong:
        complain(line.body[0].number, f"{wrong[0]!r} cannot be the name of a column, or is there twice")
    elif len(rows) > MOST_ROWS:
        complain(line.number, f"this table has {len(rows)} rows, and {MOST_ROWS} are the most")
    else:
        odd = [each for each in line.body if len(each.words) != len(names)]
        for each in odd:
            complain(each.number, f"this row has {len(each.words)} values for {len(names)} names")
        return None if odd else Table(names, tuple(rows))
    return None


def _name(line: RawLine, before: Sequence[str], complain: Complain) -> str:
    name = " ".join(line.words[1:])
    if not name or "::" in name or not name.isprintable():
        complain(line.number, "`trial` needs a name behind it, without `::`")
    elif name in before:
        complain(line.number, f"there is a trial {name!r} already")
    return name
