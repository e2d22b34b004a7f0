"""The text of rules as a tree: read, with places, and written again in one form only. Pure.

What CLIPS is given is never an author's text but what `show` writes of the tree, so that CLIPS and the guard
(`guard`) can never read one text in two ways.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

import msgspec

from robotree.vr.base.written import Mark, Scalar, Word, value_of

DEEPEST = 32
"""Levels of brackets. CLIPS reads them by recursion in C: thousands of them would end the process."""

Sort = Literal["symbol", "string", "number", "variable", "mark"]


class Atom(msgspec.Struct, frozen=True):
    """One token."""

    sort: Sort
    text: str
    """As it is meant: a string without quotes, a variable with its `?` or `$?`."""
    mark: Mark = Mark()


class Form(msgspec.Struct, frozen=True):
    """A pair of brackets and what is in it."""

    parts: tuple[Node, ...]
    mark: Mark = Mark()

    @property
    def head(self) -> str:
        """The symbol with which it begins; empty: it begins with something else."""
        first = self.parts[0] if self.parts else None
        return first.text if isinstance(first, Atom) and first.sort == "symbol" else ""

    @property
    def rest(self) -> tuple[Node, ...]:
        """The nodes after the head."""
        return self.parts[1:]


Node = Atom | Form

_TOKEN = re.compile(
    r"""
      (?P<space> [ \t\r\n]+ | ;[^\n]* )
    | (?P<string> "(?:[^"\\]|\\.)*" )
    | (?P<open> \( ) | (?P<close> \) )
    | (?P<arrow> <-|=>(?=[\s(]) )
    | (?P<compare> <=>|<=|<>|< )
    | (?P<mark> [&|~] | [:=](?=\() )
    | (?P<variable> \$?\?(?:[^\W\d][\w.-]*)? )
    | (?P<number> [-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?=[\s()&|;]|\Z) )
    | (?P<symbol> [^\s()"&|<~;?$\\][^\s()"&|<~;\\]* )
    """,
    re.VERBOSE | re.DOTALL,
)
_UNFIT = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)
_WORD = re.compile(r"[^\W\d][\w-]*=?\Z")


def read(source: str, path: str) -> tuple[Form, ...]:
    """Read all forms of a text.

    Raises:
        BrokenScript: the text is not made of whole tokens and closed brackets, or is nested too deep.
    """
    if found := _UNFIT.search(source):
        mark = _place(source, found.start(), path)
        raise mark.error(f"the invisible character U+{ord(found.group()):04X} cannot stand here: remove it")
    open_forms: list[tuple[list[Node], Mark]] = []
    whole: list[Form] = []
    for sort, text, mark in _tokens(source, path):
        if sort == "open":
            if len(open_forms) >= DEEPEST:
                raise mark.error(f"brackets are nested more than {DEEPEST} levels deep")
            open_forms.append(([], mark))
            continue
        if not open_forms:
            raise mark.error(f"{text!r} stands outside of all brackets")
        if sort != "close":
            open_forms[-1][0].append(_atom(sort, text, mark))
            continue
        parts, began = open_forms.pop()
        form = Form(tuple(parts), began)
        if open_forms:
            open_forms[-1][0].append(form)
        else:
            whole.append(form)
    if open_forms:
        raise open_forms[-1][1].error("this bracket is never closed")
    return tuple(whole)


def _tokens(source: str, path: str) -> Iterator[tuple[str, str, Mark]]:
    at, line, begin = 0, 1, 0
    while at < len(source):
        found = _TOKEN.match(source, at)
        mark = Mark(path, line, at - begin + 1)
        if found is None:
            raise mark.error(
                f"{source[at]!r} cannot be read here: a string that is not closed, or a stray character"
            )
        text = found.group()
        if found.lastgroup != "space":
            yield str(found.lastgroup), text, mark
        if newlines := text.count("\n"):
            line, begin = line + newlines, at + text.rindex("\n") + 1
        at = found.end()


def _place(source: str, at: int, path: str) -> Mark:
    line = source.count("\n", 0, at) + 1
    return Mark(path, line, at - (source.rfind("\n", 0, at) + 1) + 1)


def _atom(sort: str, text: str, mark: Mark) -> Atom:
    if sort == "string":
        return Atom("string", re.sub(r"\\(.)", r"\1", text[1:-1], flags=re.DOTALL), mark)
    if sort in {"arrow", "compare", "symbol"}:
        return Atom("symbol", text, mark)
    if sort == "number":
        value_of(Word(text, mark))  # it says whether it is too large
    if sort in {"mark", "variable", "number"}:
        return Atom(sort, text, mark)  # type: ignore[arg-type] # mypy does not narrow a str to literals
    raise mark.error(f"{text!r} cannot be read here")


def plain(text: str, mark: Mark = Mark()) -> Atom:  # noqa: B008 # frozen
    """Return a text as a value of facts."""
    return Atom("string", text, mark)


def is_word(text: str) -> bool:
    """Whether a text is written without quotes."""
    return _WORD.match(text) is not None


def form(head: str, *parts: Node, mark: Mark = Mark()) -> Form:  # noqa: B008 # frozen
    """Return brackets with a head."""
    return Form((Atom("symbol", head, mark), *parts), mark)


def show(node: Node) -> str:
    """Write a tree as CLIPS reads it.

    One word is written as a symbol, with or without quotes in the source: so the same text is always the same
    value, whether it was typed in a rule, came in a message or was computed.
    """
    if isinstance(node, Form):
        return f"({' '.join(map(show, node.parts))})"
    if node.sort == "string" and not is_word(node.text):
        return '"' + node.text.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return node.text


def variables(node: Node) -> Iterator[str]:
    """Return the names of the variables in a tree, without `?` and `$`, in the order written."""
    if isinstance(node, Form):
        for part in node.parts:
            yield from variables(part)
    elif node.sort == "variable" and node.text.strip("$?"):
        yield node.text.lstrip("$?")


def value(node: Node) -> Scalar:
    """Return a plain value that stands in a text.

    Raises:
        BrokenScript: it is none.
    """
    if not isinstance(node, Atom) or node.sort not in {"symbol", "string", "number"}:
        raise node.mark.error("this must be a plain value: a word, a text in quotes or a number")
    if node.sort == "number":
        return int(node.text) if node.text.lstrip("+-").isdigit() else float(node.text)
    return {"TRUE": True, "FALSE": False}.get(node.text, node.text) if node.sort == "symbol" else node.text
