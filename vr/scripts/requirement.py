"""What a robot must be to be chosen: `battery > 30 and near hall`. Pure.

The language is that of formulas in scripts (`formula`). A word stands for what the robot says of itself:

    battery, load, x        its readings, in the units in which it publishes them; `30 %` is 0.3
    kind, name, host        `kind = Rover` holds for robots of this kind, also of a more special one
    place, colour, …        its attributes; a word alone holds if the attribute is yes, or the reading not 0
    near hall               it says that it is there: its attribute `place`, or one of `near`, is this word
    has wave                it has this command
    in cleaners             it is a member of this group
    and, or, not, ( )       also written as & | !

What a robot does not say of itself does not hold, whatever is asked of it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache

import msgspec

from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.base.errors import BrokenScript, RequirementUnreadable
from robotree.vr.base.group import RobotGroup
from robotree.vr.base.written import Mark, Scalar
from robotree.vr.scripts.expression import COMPARE, Atom, Form, FormulaReader, Node, form, plain

NEAR, WITHIN, HAS = "near", "in", "has"
DEEPEST = 4
"""Groups in groups."""
PLACES = ("place", "near")
"""Attributes with the places at which a robot says that it is; several are separated by commas."""
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)\s*%?)|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<sign><=|>=|!=|==|[-+*/<>=()&|!])|(?P<word>[^\W\d](?:[\w-]*\w)?))"
)


class KnownRobot(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of one robot."""

    name: str
    kinds: tuple[str, ...] = ()
    commands: frozenset[str] = frozenset()
    words: Mapping[str, Scalar] = {}
    """Attributes, and readings where they are known, by name."""
    whole: bool = True
    """Whether that is all: False for a listing, which has no readings."""

    @classmethod
    def described(cls, robot: RobotDescription) -> KnownRobot:
        """Return what a description says."""
        words: dict[str, Scalar] = {**robot.attributes, "host": robot.host, **robot.readings}
        commands = frozenset(one.name for one in robot.commands if one.available)
        return cls(name=robot.name, kinds=robot.kinds, commands=commands, words=words)

    @classmethod
    def listed(cls, robot: Listing) -> KnownRobot:
        """Return what a listing says."""
        words: dict[str, Scalar] = {**robot.attributes, "host": robot.host}
        commands = frozenset(robot.commands)
        return cls(name=robot.name, kinds=robot.kinds, commands=commands, words=words, whole=False)


class Requirement(msgspec.Struct, frozen=True):
    """A requirement that was read."""

    text: str
    node: Node | None
    """None: nothing is required."""

    def holds(self, known: KnownRobot) -> bool | None:
        """Whether a robot fulfils it; None: too little is known of it."""
        return True if self.node is None else _truth(self.node, known)

    def seen(self, known: KnownRobot) -> str:
        """Return what the robot says where this asks: `battery 62, place hall`; empty: nothing."""
        told: list[str] = []
        for word in dict.fromkeys(() if self.node is None else _asked(self.node)):
            value = known.words.get(word)
            if value is not None:
                told.append(f"{word} {value:.6g}" if isinstance(value, float) else f"{word} {value}")
            elif word not in {"kind", "name", *PLACES, WITHIN}:
                told.append(f"no {word}")
        return ", ".join(told)

    @property
    def names_groups(self) -> bool:
        """Whether it names a group: then it is to be completed by `expanded`."""
        return self.node is not None and _names_group(self.node)

    def expanded(self, group: Callable[[str], RobotGroup]) -> Requirement:
        """Return the same with each group that it names replaced by its members and its rule.

        Args:
            group: returns the group of a name.

        Raises:
            RequirementUnreadable: a group is a part of itself.
            VrError: there is no such group, or its rule cannot be read.
        """
        if self.node is None or not self.names_groups:
            return self
        return Requirement(self.text, _expanded(self.node, group, self.text, ()))


class _Reader(FormulaReader):
    token = _TOKEN
    either, both, negation = ("or", "|"), ("and", "&"), ("not", "!")

    def named(self, word: str) -> Node:
        if word in {NEAR, WITHIN, HAS}:
            return form(word, plain(self._argument(word), self._mark), mark=self._mark)
        return Atom("variable", f"?{word}", self._mark)

    def number_of(self, text: str) -> Scalar:
        share = text.endswith("%")
        value = super().number_of(text.rstrip("% \t"))
        return float(value) / 100.0 if share else value

    def _argument(self, word: str) -> str:
        if self._at >= len(self._tokens) or self._tokens[self._at][0] not in {"word", "text"}:
            self._fail(f"a name is missing after {word!r} in")
        sort, text = self._tokens[self._at]
        self._at += 1
        return text[1:-1] if sort == "text" else text

    def _comparison(self) -> Node:
        """Read a comparison; what stands right of an `=` is a word that is meant itself."""
        left = self._sum()
        sign = self._take(*COMPARE)
        if not sign:
            if isinstance(left, Atom) and left.sort in {"number", "string"}:
                self._fail(f"{left.text!r} alone is no condition in")
            return left
        if sign not in {"=", "==", "!="}:
            return form(COMPARE[sign], self._number(left), self._number(self._sum()), mark=self._mark)
        right = self._sum()
        if isinstance(right, Atom) and right.sort == "variable":
            right = plain(right.text[1:], self._mark)
        return form({"!=": "neq"}.get(sign, "eq"), left, right, mark=self._mark)


@lru_cache(maxsize=256)
def requirement(text: str) -> Requirement:
    """Read a requirement; an empty one is fulfilled by each robot.

    Raises:
        RequirementUnreadable: it is none.
    """
    if not text.strip():
        return Requirement("", None)
    try:
        node = _Reader(text, Mark()).whole()
        _check(node)
    except BrokenScript as error:
        raise RequirementUnreadable(text=text, reason=str(error.data["reason"])) from None
    return Requirement(text, node)


def _check(node: Node) -> None:
    """Refuse what can never hold: a condition among numbers, or `kind` compared as a number."""
    if isinstance(node, Atom):
        return
    numbers = node.head in {"<", "<=", ">", ">=", "+", "-", "*", "/"}
    compares = numbers or node.head in {"eq", "neq"}
    for part in node.rest:
        if isinstance(part, Form) and part.head not in {"+", "-", "*", "/"} and compares:
            raise node.mark.error("a condition cannot stand where a number is wanted: use brackets and `and`")
        if numbers and isinstance(part, Atom) and part.text in {"?kind", "?name", "?host", "?place"}:
            raise node.mark.error(f"{part.text[1:]} is no number: compare it by = or !=")
        _check(part)


def _truth(node: Node, known: KnownRobot) -> bool | None:  # noqa: PLR0911 # one for each form
    if isinstance(node, Atom):
        return _alone(node, known)
    match node.head:
        case "and":
            return _all(_truth(part, known) for part in node.rest)
        case "or":
            return _not(_all(_not(_truth(part, known)) for part in node.rest))
        case "not":
            return _not(_truth(node.rest[0], known))
        case "near":
            return _is_near(_text(node.rest[0]), known)
        case "has":
            return _text(node.rest[0]) in known.commands
        case "named":
            return any(_text(part) == known.name for part in node.rest)
        case "in":
            return None  # it was not asked who is in the group
        case "eq" | "neq":
            same = _same(node.rest[0], node.rest[1], known)
            return same if node.head == "eq" or same is None else not same
        case sign:
            return _compared(sign, node, known)


def _all(parts: Iterable[bool | None]) -> bool | None:
    found = [*parts]
    return False if False in found else None if None in found else True


def _not(truth: bool | None) -> bool | None:  # noqa: FBT001 # there is no other argument
    return None if truth is None else not truth


def _alone(node: Atom, known: KnownRobot) -> bool | None:
    """Whether a word alone holds: `charged`."""
    if node.sort != "variable":
        return node.text in {"TRUE", "yes"}
    value = known.words.get(node.text[1:])
    if value is None:
        return False if known.whole else None
    return value.lower() in {"yes", "true"} if isinstance(value, str) else bool(value)


def _is_near(place: str, known: KnownRobot) -> bool | None:
    said = [str(known.words[word]) for word in PLACES if word in known.words]
    places = {one.strip().lower() for text in said for one in text.split(",")}
    return place.lower() in places or (None if not known.whole and not places else False)


def _same(left: Node, right: Node, known: KnownRobot) -> bool | None:
    wanted = _value(right, known)
    if isinstance(left, Atom) and left.text == "?kind":
        return str(wanted) in known.kinds
    found = _value(left, known)
    if found is None or wanted is None:
        return False if known.whole else None
    if isinstance(found, str) or isinstance(wanted, str):
        return _words(found) == _words(wanted)
    return found == wanted


def _words(value: Scalar) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return {"true": "yes", "false": "no"}.get(text.lower(), text)


def _compared(sign: str, node: Form, known: KnownRobot) -> bool | None:
    one, other = (_number(part, known) for part in node.rest)
    if one is None or other is None:
        return False if known.whole else None
    compared = {"<": one < other, "<=": one <= other, ">": one > other, ">=": one >= other}
    return compared.get(sign, False)


def _number(node: Node, known: KnownRobot) -> float | None:
    """Return a number; None: it is none, or is not known."""
    if isinstance(node, Atom):
        value = _value(node, known)
        try:
            return None if value is None else float(value)
        except ValueError:
            return None
    one, other = (_number(part, known) for part in node.rest)
    if one is None or other is None or (node.head == "/" and not other):
        return None
    if node.head in {"+", "-"}:
        return one + other if node.head == "+" else one - other
    return one * other if node.head == "*" else one / other


def _value(node: Node, known: KnownRobot) -> Scalar | None:
    if isinstance(node, Form):
        return _number(node, known)
    if node.sort == "number":
        return float(node.text)
    if node.sort != "variable":
        return node.text == "TRUE" if node.text in {"TRUE", "FALSE"} else node.text
    word = node.text[1:]
    return known.name if word == "name" else known.words.get(word)


def _text(node: Node) -> str:
    return node.text if isinstance(node, Atom) else ""


def _asked(node: Node) -> Iterator[str]:
    """Return the words that a requirement asks for, in the order written."""
    if isinstance(node, Atom):
        if node.sort == "variable":
            yield node.text[1:]
        return
    if node.head == NEAR:
        yield from PLACES
    elif node.head not in {WITHIN, HAS, "named"}:
        for part in node.rest:
            yield from _asked(part)


def _names_group(node: Node) -> bool:
    return isinstance(node, Form) and (node.head == WITHIN or any(map(_names_group, node.rest)))


def _expanded(node: Node, group: Callable[[str], RobotGroup], text: str, within: tuple[str, ...]) -> Node:
    if not isinstance(node, Form):
        return node
    if node.head != WITHIN:
        return Form((node.parts[0], *(_expanded(part, group, text, within) for part in node.rest)), node.mark)
    name = _text(node.rest[0])
    if name in within or len(within) >= DEEPEST:
        reason = f"group {name} is a part of itself: {' > '.join((*within, name))}"
        raise RequirementUnreadable(text=text, reason=reason)
    found = group(name)
    members: Node = form("named", *map(plain, found.names))
    rule = requirement(found.rule).node
    return members if rule is None else form("or", members, _expanded(rule, group, text, (*within, name)))


def member_rule(group: RobotGroup, find: Callable[[str], RobotGroup]) -> Requirement:
    """Return what the members of a group fulfil.

    Raises:
        VrError: its rule cannot be read, or names a group that there is not.
    """
    node = form(WITHIN, plain(group.name))
    return Requirement("", node).expanded(lambda name: group if name == group.name else find(name))
