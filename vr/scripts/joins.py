"""In how many ways the conditions of a rule may be met: bounded in the matcher, judged before a run. Pure.

CLIPS compares facts in C, and nothing there can be interrupted: four conditions without a shared variable
over 200 facts have 200^4 partial matches. So each join that the engine builds counts its own comparisons, in
a function of CLIPS, and is false from `MOST_COMPARISONS` on: no further partial match is made. What is left
then is to go once through one list at each level, which is not more than what is there.

    (defrule pairs (place (id ?a)) (place (id ?b)) => …)
    (defrule pairs ?f <- (place (id ?a)) (place (id ?b&:(and (robotree-join-0) (eq ?f ?f)))) => …)

The test stands in the first slot, so that it is evaluated for each comparison and before all others; it names
a variable that only conditions above have, or CLIPS would evaluate it once for each fact, before all joins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec

from robotree.vr.base.written import Mark
from robotree.vr.scripts.expression import Atom, Form, Node, form, variables
from robotree.vr.scripts.program import MESSAGE, PARAMETER, PARTNER, ROLE, FactTemplate, Rule

MOST_COMPARISONS = 50_000
"""Pairs that the joins of all rules may compare for one happening."""
COUNT = "robotree-comparisons"
"""The variable of CLIPS in which they are counted."""
CROWDED = "robotree-crowded"
"""The function of ours that is told the number of the rule whose join was compared last."""

FindFacts = Callable[[str], FactTemplate | None]
_NESTED = frozenset({"and", "or", "not", "exists", "forall"})


def counter() -> str:
    """Return the variable that counts, as CLIPS reads it."""
    return f"(defglobal ?*{COUNT}* = 0)"


def join_function(number: int) -> str:
    """Return the test for the joins of one rule for CLIPS; arguments would make it five times slower."""
    more = f"(< (bind ?*{COUNT}* (+ ?*{COUNT}* 1)) {MOST_COMPARISONS})"
    last = f"(if (= ?*{COUNT}* {MOST_COMPARISONS}) then ({CROWDED} {number}))"
    return f"(deffunction {_name(number)} () (if {more} then TRUE else {last} FALSE))"


def bounded(rule: Form, number: int, find: FindFacts) -> Form | None:
    """Return a rule whose joins count their comparisons; None: it joins nothing.

    Args:
        rule: the whole `defrule`, as the guard lets it through.
        number: of the rule, for `join_function`.
        find: returns a kind of fact.
    """
    walk = _Walk(number, find)
    parts = walk.conditions(rule.parts)
    return Form(tuple(parts), rule.mark) if walk.joins else None


def _name(number: int) -> str:
    return f"robotree-join-{number}"


class _Walk:
    """Goes through the conditions of one rule from the first to the last."""

    def __init__(self, number: int, find: FindFacts) -> None:
        self._number, self._find = number, find
        self._known: tuple[Atom, ...] = ()
        """Variables that conditions above have given a value; a fact's name is never one of a slot."""
        self._named: Atom | None = None
        """The name of the fact that comes next."""
        self._first = True
        self.joins = 0

    def conditions(self, parts: Sequence[Node]) -> list[Node]:
        """Return conditions with their tests; all that is no condition stays as it is."""
        done: list[Node] = []
        for at, part in enumerate(parts):
            if isinstance(part, Atom) and part.text == "=>":
                return [*done, *parts[at:]]
            pattern = isinstance(part, Form) and part.head not in _NESTED | {"test", "declare"}
            if pattern and self._first and self._named is None:
                self._named = Atom("variable", "?robotree-fact")
                done += [self._named, Atom("symbol", "<-")]
            done += [part] if isinstance(part, Atom) or part.head in {"test", "declare"} else self._one(part)
            follows = parts[at + 1] if at + 1 < len(parts) else None
            if isinstance(part, Atom) and isinstance(follows, Atom) and follows.text == "<-":
                self._named = part
        return done

    def _one(self, part: Form) -> list[Node]:
        if part.head not in _NESTED:
            return self._pattern(part, negated=False)
        before = self._known
        if part.head == "not" and isinstance(inner := part.rest[0], Form) and inner.head not in _NESTED:
            (only,) = self._pattern(inner, negated=True)
            self._known = before
            return [form("not", only, mark=part.mark)]
        inside: list[Node] = []
        for one in part.rest:
            made = self._one(one) if isinstance(one, Form) and one.head != "test" else [one]
            whole = len(made) == 1 or part.head in {"and", "forall"}
            inside += made if whole else [form("and", *made, mark=part.mark)]
            self._known = before if part.head == "or" else self._known
        self._known = self._known if part.head == "and" else before
        return [form(part.head, *inside, mark=part.mark)]

    def _pattern(self, pattern: Form, *, negated: bool) -> list[Node]:
        known, first = self._known, self._first
        self._first = False
        if not negated:
            self._known = (*known, *([self._named] if self._named else []), *_given(pattern))
            self._named = None
        if first:
            return [pattern]
        self.joins += 1
        template, own = self._find(pattern.head), {*variables(pattern)}
        above = next((one for one in known if one.text.lstrip("$?") not in own), None)
        if above is not None and template is not None and template.slots:
            return [self._within(pattern, template, above)]
        # without a variable from above every fact fits: a test behind counts all, a `no` ends at the first
        return [pattern] if negated else [pattern, form("test", form(_name(self._number)))]

    def _within(self, pattern: Form, template: FactTemplate, known: Atom) -> Form:
        """Return a pattern with the test in its first slot."""
        new = Atom("variable", f"?robotree-{self.joins}", pattern.mark)
        same = form("eq", known, known)
        test: list[Node] = [
            Atom("mark", "&"),
            Atom("mark", ":"),
            form("and", form(_name(self._number)), same),
        ]
        slots = [part for part in pattern.rest if isinstance(part, Form)]
        if not slots:
            slot = template.slots[0]
            new = Atom("variable", f"$?robotree-{self.joins}") if slot.several else new
            return form(pattern.head, form(slot.name, new, *test), mark=pattern.mark)
        head, (first, *rest) = slots[0].head, slots[0].rest
        if isinstance(first, Atom) and first.sort == "variable":
            named = first if first.text.strip("$?") else Atom("variable", f"{first.text}{new.text[1:]}")
            made = form(head, named, *test, *rest, mark=slots[0].mark)
        else:
            made = form(head, new, *test, Atom("mark", "&"), first, *rest, mark=slots[0].mark)
        return form(pattern.head, made, *slots[1:], mark=pattern.mark)


def _given(pattern: Form) -> Iterator[Atom]:
    """Yield the variables that a pattern gives a value."""
    for slot in pattern.rest:
        parts = slot.rest if isinstance(slot, Form) else ()
        either = any(isinstance(part, Atom) and part.text == "|" for part in parts)
        first = parts[0] if parts else None
        if not either and isinstance(first, Atom) and first.sort == "variable" and first.text.strip("$?"):
            yield first


class Loose(msgspec.Struct, frozen=True):
    """A rule of which parts have nothing in common: the numbers of their facts are multiplied."""

    rule: str
    mark: Mark
    kinds: tuple[str, ...]
    """Kind of fact of the first condition of each part."""


def loose(rule: Rule) -> Loose | None:
    """Return how a rule falls into parts that share no variable; None: at most one of them has many facts.

    A part with a happening, a parameter, a partner or a role is met a few times: it is not counted.
    """
    groups: list[tuple[set[str], list[str]]] = []
    for names, kind in _joined(rule.form.rest):
        shared = [group for group in groups if group[0] & names]
        merged = (
            set(names).union(*(one[0] for one in shared)),
            [*(k for one in shared for k in one[1]), kind],
        )
        groups = [*(group for group in groups if group not in shared), merged]
    once = {MESSAGE, PARAMETER, PARTNER, ROLE}
    many = [kinds[0] for _, kinds in groups if not once & set(kinds)]
    return Loose(rule.name, rule.mark, tuple(many)) if len(many) > 1 else None


def _joined(parts: Sequence[Node]) -> Iterator[tuple[set[str], str]]:
    """Yield the variables and the kind of fact of each condition that a fact must meet."""
    for part in parts:
        if isinstance(part, Atom) and part.text == "=>":
            return
        if not isinstance(part, Form) or part.head in {"test", "declare", "not", "exists", "forall"}:
            continue
        if part.head in {"and", "or"}:
            yield from _joined(part.rest)
        else:
            yield set(variables(part)), part.head
