"""The words of a rule: everything that is not listed here is refused before CLIPS sees it. Pure.

A rule script is code: CLIPS can run programs (`system`), open files, load more code and end the process. No
name can be taken out of CLIPS, but which function is called is fixed by the text: so a list of what may stand
at the head of each bracket, checked on our own tree, is enough. Loops, recursion and code made of text are
not on it.

Memory is bounded as well: texts and lists are put together by functions of ours, and after each assertion the
memory of the environment is looked at (`CHECK`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from robotree.vr.base.written import Mark, Scalar
from robotree.vr.scripts.expression import Atom, Form, Node, form, show, variables
from robotree.vr.scripts.program import (
    CHOICE,
    MESSAGE,
    MOST_CONDITIONS,
    PARAMETER,
    PARTNER,
    READING,
    ROLE,
    Condition,
    FactTemplate,
    check_name,
)

Find = Callable[[str], FactTemplate | None]

CHECK = "robotree-check"
PURE = frozenset({
    "+", "-", "*", "/", "div", "mod", "abs", "min", "max", "round", "integer", "float", "sqrt", "=",
    "<>", "<", "<=", ">", ">=", "eq", "neq", "and", "or", "not", "numberp", "integerp", "floatp",
    "lexemep", "stringp", "symbolp", "evenp", "oddp", "length$", "nth$", "member$", "first$", "rest$",
    "subseq$", "text", "fields",
})  # fmt: skip
"""Functions that compute a value and do nothing else."""
REWRITTEN = {"str-cat": "text", "create$": "fields"}
"""Functions of CLIPS that are replaced by bounded ones of ours."""
ACTS = {
    "do": (2, "a partner and an act"),
    "do-as": (3, "a conversation, a partner and an act"),
    "cancel": (1, "a conversation or a partner"),
    "ask": (1, "a question and its answers"),
    "ask-as": (2, "a conversation, a question and its answers"),
    "reply": (2, "a conversation and a performative"),
    "play": (2, "a partner and a role"),
    "wait": (2, "a name and seconds"),
    "log": (1, "a text"),
    "end": (0, ""),
    "fail": (1, "a reason"),
}
"""The actions of a rule, with the least number of their values."""
INSTEAD = {
    "printout": "(log …)",
    "format": "(log …)",
    "halt": "(end …)",
    "exit": "(end …)",
    "while": "a rule that fires again",
    "loop-for-count": "a rule that fires again",
    "send": "(do …)",
    "sym-cat": "(str-cat …)",
}
KEPT = frozenset({MESSAGE, PARTNER, PARAMETER, ROLE, READING, CHOICE})
"""Facts that come from outside: rules look at them and cannot make them."""
MOST_LISTS = 3
"""Parts of any length in one slot: a list of 64 values is split into so many in 2,145 ways."""
HIGHEST = 10_000
"""Largest salience, as in CLIPS."""


class Guard:
    """Checks one rule."""

    def __init__(self, find: Find) -> None:
        """Take how kinds of facts are found."""
        self._find = find
        self._bound: set[str] = set()
        self._facts: dict[str, FactTemplate] = {}
        self._conditions: list[Condition] = []
        self._rewrites = 0

    def rule(self, rule: Form) -> tuple[Form, tuple[Condition, ...], str]:
        """Return a rule as it may be built, its conditions, and its text of explanation.

        Raises:
            BrokenScript: something in it may not be said.
        """
        name, doc, rest = named(rule, "a rule")
        parts: list[Node] = [name]
        if rest and isinstance(rest[0], Form) and rest[0].head == "declare":
            parts.append(_salience(rest[0]))
            rest = rest[1:]
        arrow = next((at for at, part in enumerate(rest) if _is(part, "=>")), None)
        if arrow is None:
            raise rule.mark.error(f"rule {name.text} has no =>")
        parts += self._left(rest[:arrow])
        if len(self._conditions) > MOST_CONDITIONS:
            raise rule.mark.error(
                f"rule {name.text} has more than {MOST_CONDITIONS} conditions; make two rules of it"
            )
        parts.append(Atom("symbol", "=>"))
        for action in rest[arrow + 1 :]:
            parts += self._action(action)
        if parts[-1] == form(CHECK):
            parts.pop()  # the engine looks after each rule
        return form("defrule", *parts, mark=rule.mark), tuple(self._conditions), doc

    # -- conditions --------------------------------------------------------------------------------

    def _left(self, parts: Sequence[Node]) -> list[Node]:
        done: list[Node] = []
        rest = list(parts)
        while rest:
            part = rest.pop(0)
            if isinstance(part, Atom) and part.sort == "variable" and rest and _is(rest[0], "<-"):
                rest.pop(0)
                pattern = rest.pop(0) if rest else None
                if not isinstance(pattern, Form):
                    raise part.mark.error(f"{part.text} <- needs a fact behind it")
                done += [part, Atom("symbol", "<-"), self._pattern(pattern)]
                template = self._find(pattern.head)
                if template is not None:
                    self._facts[part.text] = template
            elif isinstance(part, Form):
                done.append(self._condition(part))
            else:
                raise part.mark.error(f"{part.text!r} is no condition")
        return done

    def _condition(self, part: Form, *, negated: bool = False) -> Form:
        match part.head:
            case "test":
                if len(part.rest) != 1:
                    raise part.mark.error("test takes one expression")
                self._conditions.append(Condition(text=show(part), mark=part.mark))
                return form("test", self._expression(part.rest[0]), mark=part.mark)
            case "not" | "exists":
                if len(part.rest) != 1 or not isinstance(part.rest[0], Form):
                    raise part.mark.error(f"{part.head} takes one condition")
                inner = self._inside(part.rest, negated=negated != (part.head == "not"))
                return form(part.head, *inner, mark=part.mark)
            case "and" | "or" | "forall":
                if not part.rest:
                    raise part.mark.error(f"{part.head} takes conditions")
                inside = part.head == "forall"
                inner = self._inside(part.rest, negated=negated) if inside else self._each(part.rest, negated)
                if part.head == "or":
                    self._rewrites += len(inner) - 1
                    if self._rewrites > 3:
                        raise part.mark.error(
                            "more than four alternatives in one rule; make several rules of it"
                        )
                return form(part.head, *inner, mark=part.mark)
            case _:
                return self._pattern(part, negated=negated)

    def _each(self, parts: Iterable[Node], negated: bool) -> list[Node]:  # noqa: FBT001 # internal
        done: list[Node] = []
        for part in parts:
            if not isinstance(part, Form):
                raise part.mark.error(f"{part.text!r} is no condition")
            done.append(self._condition(part, negated=negated))
        return done

    def _inside(self, parts: Iterable[Node], *, negated: bool) -> list[Node]:
        """Check conditions whose variables do not reach outside."""
        before = set(self._bound)
        done = self._each(parts, negated)
        self._bound = before
        return done

    def _pattern(self, pattern: Form, *, negated: bool = False) -> Form:
        template = self._template(pattern)
        wanted: dict[str, Scalar] = {}
        slots: list[Node] = []
        for part in pattern.rest:
            if not isinstance(part, Form):
                raise part.mark.error(
                    f"write the slots of {template.name} in brackets: ({template.name} (slot value))"
                )
            self._slot(template, part)
            slots.append(form(part.head, *self._constraint(part.rest), mark=part.mark))
            if (
                len(part.rest) == 1
                and isinstance(one := part.rest[0], Atom)
                and one.sort in {"symbol", "string", "number"}
            ):
                wanted[part.head] = one.text
        self._conditions.append(
            Condition(
                text=show(pattern), mark=pattern.mark, template=template.name, wanted=wanted, negated=negated
            )
        )
        return form(template.name, *slots, mark=pattern.mark)

    def _constraint(self, parts: Sequence[Node]) -> list[Node]:
        done: list[Node] = []
        lists = [part for part in parts if isinstance(part, Atom) and part.text.startswith("$?")]
        if len(lists) > MOST_LISTS:
            raise lists[0].mark.error(
                f"a list is split in too many ways: at most {MOST_LISTS} parts of any length ($?, or `has`)"
            )
        for at, part in enumerate(parts):
            if isinstance(part, Atom):
                done.append(part)
                if part.sort == "variable":
                    self._bound.update(variables(part))
            elif (
                at
                and isinstance(before := parts[at - 1], Atom)
                and before.sort == "mark"
                and before.text in ":="
            ):
                done.append(self._expression(part))
            else:
                raise part.mark.error(
                    f"({part.head} …) cannot stand in a slot; a test is written as ?x&:(> ?x 3)"
                )
        return done

    # -- actions -----------------------------------------------------------------------------------

    def _action(self, action: Node) -> list[Node]:
        if not isinstance(action, Form):
            raise action.mark.error(f"{action.text!r} is no action")
        head, rest, mark = action.head, action.rest, action.mark
        if head in ACTS:
            least, what = ACTS[head]
            if len(rest) < least:
                raise mark.error(f"{head} needs {what}")
            return [form("note" if head == "log" else head, *map(self._expression, rest), mark=mark)]
        actions: dict[str, Callable[[Form], list[Node]]] = {
            "assert": self._assert,
            "modify": self._change,
            "duplicate": self._change,
            "retract": self._retract,
            "bind": self._bind,
            "if": self._choice,
        }
        if head not in actions:
            raise mark.error(_not_known(head, "no action that a rule may take"))
        return actions[head](action)

    def _assert(self, action: Form) -> list[Node]:
        made = [form("assert", self._new(fact), mark=action.mark) for fact in action.rest]
        return [one for fact in made for one in (fact, form(CHECK))]

    def _change(self, action: Form) -> list[Node]:
        fact = action.rest[0] if action.rest else None
        if not isinstance(fact, Atom) or fact.text not in self._facts:
            raise action.mark.error(f"{action.head} needs a fact that a condition has named: ?f <- (…)")
        template = self._facts[fact.text]
        self._mine(template, action.mark)
        values = self._values(template, action.rest[1:])
        return [form(action.head, fact, *values, mark=action.mark), form(CHECK)]

    def _retract(self, action: Form) -> list[Node]:
        for fact in action.rest:
            if not isinstance(fact, Atom) or fact.text not in self._facts:
                raise action.mark.error("retract takes facts that conditions have named: ?f <- (…)")
            if self._facts[fact.text].name != MESSAGE:
                self._mine(self._facts[fact.text], action.mark)
        return [action]

    def _bind(self, action: Form) -> list[Node]:
        rest = action.rest
        if len(rest) != 2 or not isinstance(rest[0], Atom) or rest[0].sort != "variable":
            raise action.mark.error("bind takes a variable and one value")
        value = self._act_or_value(rest[1])
        self._bound.update(variables(rest[0]))
        return [form("bind", rest[0], value, mark=action.mark)]

    def _act_or_value(self, node: Node) -> Node:
        if isinstance(node, Form) and node.head in {"do", "do-as"}:
            (done,) = self._action(node)
            return done
        return self._expression(node)

    def _choice(self, action: Form) -> list[Node]:
        rest = list(action.rest)
        if len(rest) < 3 or not _is(rest[1], "then"):
            raise action.mark.error("if is written as (if TEST then … else …)")
        done: list[Node] = [self._expression(rest[0]), rest[1]]
        for part in rest[2:]:
            done += [part] if _is(part, "else") else self._action(part)
        return [form("if", *done, mark=action.mark)]

    def _new(self, fact: Node) -> Form:
        if not isinstance(fact, Form):
            raise fact.mark.error("assert takes facts in brackets")
        template = self._template(fact)
        self._mine(template, fact.mark)
        return form(template.name, *self._values(template, fact.rest), mark=fact.mark)

    def _values(self, template: FactTemplate, slots: Sequence[Node]) -> list[Node]:
        done: list[Node] = []
        for slot in slots:
            if not isinstance(slot, Form):
                raise slot.mark.error(
                    f"write the slots of {template.name} in brackets: ({template.name} (slot value))"
                )
            self._slot(template, slot)
            known = template.slot(slot.head)
            if known is not None and not known.several and len(slot.rest) != 1:
                raise slot.mark.error(f"{template.name}.{slot.head} holds one value")
            done.append(form(slot.head, *map(self._expression, slot.rest), mark=slot.mark))
        return done

    # -- values ------------------------------------------------------------------------------------

    def _expression(self, node: Node) -> Node:
        if isinstance(node, Atom):
            if node.sort == "mark":
                raise node.mark.error(f"{node.text!r} cannot stand here")
            if (
                node.sort == "variable"
                and node.text.lstrip("$?") not in self._bound
                and node.text not in self._facts
            ):
                name = node.text.lstrip("$?")
                raise node.mark.error(
                    f"variable {name} is not known here: no condition before it gives it a value"
                )
            return node
        head = REWRITTEN.get(node.head, node.head)
        if head not in PURE:
            raise node.mark.error(_not_known(node.head, "no function that a rule may use"))
        return form(head, *map(self._expression, node.rest), mark=node.mark)

    def _template(self, pattern: Form) -> FactTemplate:
        template = self._find(pattern.head)
        if template is None:
            raise pattern.mark.error(
                f"there is no fact {pattern.head!r}; declare it first"
                if pattern.head
                else "a fact begins with its name"
            )
        return template

    def _slot(self, template: FactTemplate, slot: Form) -> None:
        if template.slot(slot.head) is None:
            known = ", ".join(one.name for one in template.slots)
            raise slot.mark.error(f"fact {template.name} has no slot {slot.head!r}; it has: {known}")

    @staticmethod
    def _mine(template: FactTemplate, mark: Mark) -> None:
        if template.name in KEPT:
            raise mark.error(f"{template.name} facts come from outside; a rule can only look at them")


def _is(node: Node, text: str) -> bool:
    return isinstance(node, Atom) and node.sort == "symbol" and node.text == text


def named(construct: Form, what: str) -> tuple[Atom, str, tuple[Node, ...]]:
    """Return the name, the text of explanation and the rest of a construct."""
    name = construct.rest[0] if construct.rest else None
    if not isinstance(name, Atom) or name.sort != "symbol":
        raise construct.mark.error(f"{what} needs a name")
    check_name(name.text, name.mark, what)
    rest = construct.rest[1:]
    if rest and isinstance(rest[0], Atom) and rest[0].sort == "string":
        return name, rest[0].text, rest[1:]
    return name, "", rest


def _salience(declare: Form) -> Form:
    only = declare.rest[0] if len(declare.rest) == 1 else None
    value = (
        only.rest[0] if isinstance(only, Form) and only.head == "salience" and len(only.rest) == 1 else None
    )
    if not isinstance(value, Atom) or value.sort != "number" or not value.text.lstrip("+-").isdigit():
        raise declare.mark.error("declare takes only (salience NUMBER), a whole number")
    if abs(int(value.text)) > HIGHEST:
        raise value.mark.error(f"salience goes from -{HIGHEST} to {HIGHEST}")
    return declare


def _not_known(head: str, what: str) -> str:
    instead = f"; use {INSTEAD[head]}" if head in INSTEAD else ""
    return f"({head or '…'} …) is {what}{instead}"
