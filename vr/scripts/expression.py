"""The text of rules as trees: expressions of CLIPS, and short formulas in YAML scripts. Pure.

Expressions are read, with places, and written again in one form only. What CLIPS is given is never an
author's text but what `show` writes of the tree, so that CLIPS and the guard (`guard`) can never read one
text in two ways.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Literal, NoReturn

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


# -- formulas: `$battery < 20`, `$count + 1` -------------------------------------------------------


_WORD_OR_SIGN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*|\.\d+)|(?P<variable>\$[^\W\d]\w*)|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<sign><=|>=|!=|==|[-+*/<>=()])|(?P<word>[^\W\d][\w-]*))"
)
COMPARE = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "=": "=", "==": "=", "!=": "<>"}
_DEEPEST = 12
_LONGEST = 60
"""Words and signs of one formula: readers and CLIPS go into its parts by recursion."""


class FormulaReader:
    """Reads one formula. What a word stands for, `named` says: here for itself.

    From loose to tight: or; and; not; < <= > >= = !=; + -; * /; brackets. Values are variables, numbers,
    words and texts in quotes.
    """

    token = _WORD_OR_SIGN
    either: tuple[str, ...] = ("or",)
    both: tuple[str, ...] = ("and",)
    negation: tuple[str, ...] = ("not",)

    def __init__(self, text: str, mark: Mark) -> None:
        """Take it apart.

        Raises:
            BrokenScript: a character cannot stand in it, or it is too long.
        """
        self._mark, self._text, self._at, self._depth = mark, text, 0, 0
        self._tokens: list[tuple[str, str]] = []
        at = 0
        while text[at:].strip():
            found = self.token.match(text, at)
            if found is None:
                raise mark.error(f"{text[at:].strip()[0]!r} cannot stand in a formula: {text}")
            self._tokens.append((str(found.lastgroup), found.group(str(found.lastgroup))))
            at = found.end()
            if len(self._tokens) > _LONGEST:
                raise mark.error(
                    f"more than {_LONGEST} words and signs in one formula; use several conditions"
                )

    def whole(self) -> Node:
        """Return the whole as a tree.

        Raises:
            BrokenScript: it is no formula.
        """
        node = self._either()
        if self._at < len(self._tokens):
            self._fail(f"{self._tokens[self._at][1]!r} is not expected in")
        return node

    def _fail(self, reason: str) -> NoReturn:
        raise self._mark.error(f"{reason} the formula: {self._text}")

    def _take(self, *texts: str) -> str:
        if self._at < len(self._tokens) and self._tokens[self._at][0] in {"sign", "word"}:
            text = self._tokens[self._at][1]
            if text in texts:
                self._at += 1
                return text
        return ""

    def _either(self) -> Node:
        node = self._both()
        while self._take(*self.either):
            node = form("or", node, self._both(), mark=self._mark)
        return node

    def _both(self) -> Node:
        node = self._negation()
        while self._take(*self.both):
            node = form("and", node, self._negation(), mark=self._mark)
        return node

    def _negation(self) -> Node:
        if self._take(*self.negation):
            return form("not", self._negation(), mark=self._mark)
        return self._comparison()

    def _comparison(self) -> Node:
        left = self._sum()
        sign = self._take(*COMPARE)
        if not sign:
            return left
        right = self._sum()
        head = COMPARE[sign]
        if head not in {"=", "<>"}:
            left, right = self._number(left), self._number(right)
        if head in {"=", "<>"} and not (_numeric(left) or _numeric(right)):
            head = {"=": "eq", "<>": "neq"}[head]
        return form(head, left, right, mark=self._mark)

    def _number(self, node: Node) -> Node:
        """Refuse a word where a number must stand: mostly a variable without its dollar sign."""
        if isinstance(node, Atom) and node.sort not in {"number", "variable"}:
            self._fail(f"{node.text!r} is no number (a variable is written ${node.text}) in")
        return node

    def _sum(self) -> Node:
        node = self._product()
        while sign := self._take("+", "-"):
            node = form(sign, self._number(node), self._number(self._product()), mark=self._mark)
        return node

    def _product(self) -> Node:
        node = self._value()
        while sign := self._take("*", "/"):
            node = form(sign, self._number(node), self._number(self._value()), mark=self._mark)
        return node

    def _value(self) -> Node:
        if self._take("("):
            self._depth += 1
            if self._depth > _DEEPEST:
                self._fail(f"more than {_DEEPEST} brackets in")
            node = self._either()
            if not self._take(")"):
                self._fail("a bracket is not closed in")
            self._depth -= 1
            return node
        if self._take("-"):
            return form("-", Atom("number", "0", self._mark), self._value(), mark=self._mark)
        if self._at >= len(self._tokens):
            self._fail("something is missing at the end of")
        sort, text = self._tokens[self._at]
        self._at += 1
        truth = {"yes": "TRUE", "no": "FALSE", "true": "TRUE", "false": "FALSE"}.get(text)
        nodes: dict[str, Callable[[], Node]] = {
            "number": lambda: Atom("number", repr(self.number_of(text)), self._mark),
            "variable": lambda: Atom("variable", f"?{text[1:]}", self._mark),
            "text": lambda: plain(text[1:-1], self._mark),
            "word": lambda: Atom("symbol", truth, self._mark) if truth else self.named(text),
        }
        if sort not in nodes:
            self._fail(f"{text!r} is not expected in")
        return nodes[sort]()

    def number_of(self, text: str) -> Scalar:
        """Return a number that is written so."""
        return value_of(Word(text, self._mark))

    def named(self, word: str) -> Node:
        """Return what a word that is no truth value stands for."""
        return plain(word, self._mark)


def formula(text: str, mark: Mark) -> Node:
    """Read a formula.

    Raises:
        BrokenScript: it is none.
    """
    return FormulaReader(text, mark).whole()


def _numeric(node: Node) -> bool:
    if isinstance(node, Form):
        return node.head in {"+", "-", "*", "/"}
    return node.sort == "number"
