"""Short formulas in YAML scripts: `$battery < 20`, `$count + 1`. Pure.

From loose to tight: or; and; not; < <= > >= = !=; + -; * /; brackets. Values are variables, numbers, words
and texts in quotes.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NoReturn

from robotree.vr.base.written import Mark, Scalar, Word, value_of
from robotree.vr.scripts.expression import Atom, Form, Node, form, plain

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*|\.\d+)|(?P<variable>\$[^\W\d]\w*)|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<sign><=|>=|!=|==|[-+*/<>=()])|(?P<word>[^\W\d][\w-]*))"
)
COMPARE = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "=": "=", "==": "=", "!=": "<>"}
_DEEPEST = 12
_LONGEST = 60
"""Words and signs of one formula: readers and CLIPS go into its parts by recursion."""


class FormulaReader:
    """Reads one formula. What a word stands for, `named` says: here for itself."""

    token = _TOKEN
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
