"""Scripts for everybody: `when` this is so, `then` do that, as YAML. Pure.

    script: guide
    partners:
      robot: {kind: Companion, needs: [say, go_to]}
    facts:
      visitor: {id: none, place: none, stage: waiting}
    hears:
      person_seen: {who: text, place: text}
    rules:
      - rule: greet
        when:
          - person_seen: {who: $who, place: $place}
          - no visitor: {id: $who}
        then:
          - remember: {visitor: {id: $who, place: $place}}
          - do: robot.say
            with: {text: "Welcome, $who"}

Each rule becomes one `defrule` (`robotree rules check FILE --listing`), made as a tree and never as text, and
goes through the same guard as an expert's.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import msgspec

from robotree.vr.base.written import Entries, Items, Mark, Word, Written, entries, items, read, value_of, word
from robotree.vr.scripts.clp import (
    TYPES,
    add_rule,
    check_choice,
    check_count,
    check_head,
    check_return,
    check_watched,
    first_fact,
    of_group,
    with_template,
)
from robotree.vr.scripts.expression import Atom, Form, Node, form, formula, plain, variables
from robotree.vr.scripts.happening import nearest, seconds_of
from robotree.vr.scripts.program import (
    MESSAGE,
    PARAMETER,
    PARTNER,
    ROLE,
    FactTemplate,
    Hears,
    Parameter,
    Partner,
    Program,
    Rule,
    ScriptSlot,
    check_identifier,
    check_name,
    literal,
)

HEAD = ("script", "doc", "partners", "parameters", "facts", "hears", "start", "begin with", "rules")
CHOSEN = ("choose", "where", "count", "group")
"""How many robots a partner is, and which."""
EVENTS = {
    "start": (),
    "done": ("partner", "act", "result", "conversation"),
    "failed": ("partner", "act", "reason", "conversation"),
    "answer": ("partner", "act", "robot", "ok", "result", "conversation"),
    "answered": ("answer", "by", "conversation"),
    "progress": ("partner", "act", "fraction", "text", "conversation"),
    "lost": ("partner", "robot", "reason"),
    "found": ("partner", "robot"),
    "stopped": ("partner", "robot", "reason"),
    "released": ("partner", "robot"),
    "timer": ("name", "conversation"),
    "message": ("from", "performative", "act", "arguments", "conversation", "reply by"),
}
"""The events, and the conditions on each."""


def values_of(event: str) -> tuple[str, ...]:
    """Return the conditions on the values of an event, in the order of its values."""
    return tuple(name for name in EVENTS[event] if name not in {"partner", "conversation"})


COMPARISONS = {"above": ">", "below": "<", "at least": ">=", "at most": "<="}
ACTIONS = (
    *("do", "ask", "remember", "forget", "update …", "wait"),
    *("cancel", "reply", "role", "log", "end", "fail"),
)
_VARIABLE = re.compile(r"\$([^\W\d]\w*)")


def read_yaml(source: str, path: str) -> Program:
    """Read a script.

    Raises:
        BrokenScript: it cannot be used, and where.
    """
    root = read(source, path)
    if not isinstance(root, Entries):
        raise root.mark.error("a script is written as `name: value`, and begins with `script: NAME`")
    root.expect(HEAD, "a script")
    name = word(root.get("script"), "`script: NAME`", root.mark)
    program = Program(name=check_identifier(name.text, name.mark, "a script"), path=path, source=source)
    program = _head(program, root)
    for key, slots in entries(root.get("facts"), "facts", root.mark):
        program = with_template(program, _template(key, slots))
    begun = items(root.get("begin with"), root.mark).items
    facts = tuple(first_fact(new_fact(fact, "a fact"), program) for fact in begun)
    rules: dict[str, Rule] = {}
    given = root.get("rules")
    if given is not None and not isinstance(given, Items):
        raise given.mark.error("rules are a list: each begins with `- rule: NAME`")
    for rule in items(given, root.mark).items:
        add_rule(rules, *_Rule(program, rule).whole())
    return msgspec.structs.replace(program, facts=facts, rules=tuple(rules.values()))


# -- the head ---------------------------------------------------------------------------------------


def _head(program: Program, root: Entries) -> Program:
    mark = root.mark
    partners = [_partner(key, given) for key, given in entries(root.get("partners"), "partners", mark)]
    parameters = [
        _parameter(key, given) for key, given in entries(root.get("parameters"), "parameters", mark)
    ]
    hears = [_hears(key, given) for key, given in entries(root.get("hears"), "hears", mark)]
    check_head(partners, parameters, hears, mark)
    for hear in hears:
        if hear.name in EVENTS:
            raise mark.error(f"{hear.name!r} cannot be the name of a message: it happens to every script")
    start = entries(root.get("start"), "start", mark)
    start.expect(("by", "itself"), "start")
    by = start.texts("by", "a name")
    itself = value_of(word(start.get("itself") or Word("no", mark), "itself", mark))
    return msgspec.structs.replace(
        program,
        doc=root.text("doc"),
        partners=tuple(partners),
        parameters=tuple(parameters),
        hears=tuple(hears),
        starters=() if by == ("anyone",) else by,
        itself=bool(itself),
    )


def _partner(key: Word, given: Written) -> Partner:
    if isinstance(given, Word):
        return Partner(name=check_identifier(key.text, key.mark, "a partner"), kind=given.text)
    facets = entries(given, "a partner", key.mark)
    facets.expect(
        ("kind", "needs", "attributes", "takes", "optional", "return", "returns", "watch", *CHOSEN, "doc"),
        "a partner",
    )
    returns = facets.get("return") or facets.get("returns")
    choose, where = (
        word(facets.get(facet) or Word("", key.mark), facet, key.mark) for facet in ("choose", "where")
    )
    group, count = facets.get("group"), facets.get("count")
    takes = entries(facets.get("takes"), "takes", key.mark)
    check_choice(Word("free", choose.mark) if group is not None and not choose.text else choose, where)
    partner = Partner(
        name=check_identifier(key.text, key.mark, "a partner"),
        kind=word(facets.get("kind"), "the kind of the partner", key.mark).text,
        needs=facets.texts("needs", "a command"),
        attributes=facets.named_texts("attributes", "an attribute"),
        takes={name.text: takes.texts(name.text, "a value") for name, _ in takes},
        optional=_yes_no(facets, "optional", key.mark),
        returns=0.0 if returns is None else _return(word(returns, "the time", key.mark)),
        choose=choose.text,
        where=where.text,
        count=0 if count is None else check_count(word(count, "the count", key.mark)),
        watched=_yes_no(
            facets, "watch", key.mark, "; of who is watched a script has the readings, and no streams"
        ),
        doc=facets.text("doc"),
    )
    check_watched(partner, key.mark)
    return partner if group is None else of_group(partner, word(group, "the group", key.mark))


def _yes_no(facets: Entries, name: str, mark: Mark, more: str = "") -> bool:
    given = facets.get(name) or Word("no", mark)
    said = value_of(given) if isinstance(given, Word) else None
    if not isinstance(said, bool):
        raise given.mark.error(f"{name} is yes or no{more}")
    return said


def _return(said: Word) -> float:
    seconds = seconds_of(said.text)
    if seconds is None:
        raise said.mark.error(f"{said.text!r} is no time: write it as `30 s` or `5 min`")
    return check_return(seconds, said.mark)


def _parameter(key: Word, given: Written) -> Parameter:
    name = check_identifier(key.text, key.mark, "a parameter")
    if isinstance(given, Word):
        return Parameter(name=name, default=value_of(given))
    facets = entries(given, "a parameter", key.mark)
    facets.expect(("default", "doc"), "a parameter")
    default = value_of(word(facets.get("default"), "the default", key.mark))
    return Parameter(name=name, default=default, doc=facets.text("doc"))


def _hears(key: Word, given: Written) -> Hears:
    parts: list[tuple[str, str]] = []
    doc = ""
    for name, kind in entries(given, "a message", key.mark):
        said = word(kind, "the type", name.mark)
        if name.text == "doc":
            doc = said.text
            continue
        if said.text not in TYPES:
            raise said.mark.error(f"{said.text!r} is no type; the types are: {', '.join(TYPES)}")
        parts.append((check_identifier(name.text, name.mark, "an argument"), said.text))
    return Hears(name=check_identifier(key.text, key.mark, "a message"), parts=tuple(parts), doc=doc)


def _template(key: Word, given: Written) -> FactTemplate:
    name = check_name(key.text, key.mark, "a fact")
    if name in EVENTS:
        raise key.mark.error(f"{name!r} cannot be the name of a fact: it happens to every script")
    slots: list[ScriptSlot] = []
    for slot, default in entries(given, "a fact", key.mark):
        check_name(slot.text, slot.mark, "a slot")
        if isinstance(default, Items):
            if default.items:
                raise default.mark.error("a slot that holds several values begins empty: []")
            slots.append(ScriptSlot(name=slot.text, several=True))
        else:
            slots.append(ScriptSlot(name=slot.text, default=value_of(word(default, "a default", slot.mark))))
    return FactTemplate(name=name, slots=tuple(slots), mark=key.mark)


def new_fact(given: Written, what: str) -> Form:
    """Return a new fact: `{visitor: {id: Anna}}`.

    Raises:
        BrokenScript: it is written in another way.
    """
    one = entries(given, what, given.mark)
    if len(one.entries) != 1:
        raise given.mark.error(f"{what} is written as `NAME: {{slot: value}}`")
    key, slots = one.entries[0]
    return form(key.text, *_slots(slots, key.mark), mark=key.mark)


# -- values -----------------------------------------------------------------------------------------


def _value(given: Written) -> Node:
    """Return what an action computes: a variable, a formula (`= $n + 1`), a text with variables, a value."""
    if not isinstance(given, Word):
        raise given.mark.error("this must be one value")
    text = given.text
    if not given.quoted and text.startswith("="):
        return formula(text[1:], given.mark)
    if "$" not in text:
        return literal(value_of(given), given.mark)
    if found := _VARIABLE.fullmatch(text):
        return Atom("variable", f"?{found.group(1)}", given.mark)
    parts: list[Node] = []
    at = 0
    for found in re.finditer(r"\$\$|" + _VARIABLE.pattern, text):
        before = text[at : found.start()] + ("$" if found.group() == "$$" else "")
        parts += [plain(before, given.mark)] if before else []
        parts += [Atom("variable", f"?{found.group(1)}", given.mark)] if found.group(1) else []
        at = found.end()
    parts += [plain(text[at:], given.mark)] if text[at:] else []
    return form("text", *parts, mark=given.mark)


def _wanted(given: Written, number: int) -> list[Node]:
    """Return what a condition wants of a slot."""
    mark = given.mark
    if isinstance(given, Items):
        return [one for part in given.items for one in _wanted(part, number)]
    if isinstance(given, Word):
        return [_wanted_word(given)]
    given.expect((*COMPARISONS, "has", "not", "any", "as"), "a wish")
    if (has := given.get("has")) is not None:
        return [Atom("variable", "$?", mark), *_wanted(has, number), Atom("variable", "$?", mark)]
    named = given.get("as")
    variable = Atom("variable", f"?slot{number}", mark) if named is None else _variable(named)
    return [variable, *(part for key, value in given for part in _compared(key, value, variable))]


def _wanted_word(given: Word) -> Node:
    if found := _VARIABLE.fullmatch(given.text):
        return Atom("variable", f"?{found.group(1)}", given.mark)
    if "$" in given.text:
        raise given.mark.error(f"{given.text!r}: a condition takes a value, or a variable alone: $name")
    if given.text in {"anything", ""} and not given.quoted:
        return Atom("variable", "?", given.mark)
    return literal(value_of(given), given.mark)


def _compared(key: Word, value: Written, variable: Atom) -> list[Node]:
    mark = key.mark
    match key.text:
        case "as":
            return []
        case "not":
            signs = Atom("mark", "&", mark), Atom("mark", "~", mark)
            return [node for one in _unwanted(value) for node in (*signs, one)]
        case "any":
            choices = _choices(value, mark)
            return [
                node
                for at, one in enumerate(choices)
                for node in (Atom("mark", "|" if at else "&", mark), one)
            ]
        case sign:
            test = form(COMPARISONS[sign], variable, _value(value), mark=mark)
            return [Atom("mark", "&", mark), Atom("mark", ":", mark), test]


def _unwanted(given: Written) -> list[Node]:
    """Return the values that a slot must not have: `not: hall`, `not: {any: [hall, kitchen]}`."""
    if isinstance(given, Word):
        return [_wanted_word(given)]
    if isinstance(given, Entries) and [key.text for key, _ in given] == ["any"]:
        return _choices(given.entries[0][1], given.mark)
    raise given.mark.error("`not` takes one value, or `{any: [value, value]}`")


def _choices(given: Written, mark: Mark) -> list[Node]:
    return [_wanted_word(word(one, "a value", mark)) for one in items(given, mark).items]


def _variable(given: Written) -> Atom:
    said = word(given, "a name", given.mark)
    found = _VARIABLE.fullmatch(said.text if said.text.startswith("$") else f"${said.text}")
    if found is None:
        raise said.mark.error(f"{said.text!r} cannot be a name")
    return Atom("variable", f"?{found.group(1)}", said.mark)


# -- one rule ---------------------------------------------------------------------------------------


class _Rule:
    """Translates one rule."""

    def __init__(self, program: Program, given: Written) -> None:
        self._program = program
        self._given = entries(given, "a rule", given.mark)
        self._given.expect(("rule", "name", "doc", "priority", "when", "then"), "a rule")
        self._number = 0
        self._names: set[str] = set()
        """Of facts, as conditions have named them."""

    def whole(self) -> tuple[Form, Program]:
        """Return the `defrule`, for the guard."""
        mark = self._given.mark
        name = word(self._given.get("rule") or self._given.get("name"), "`rule: NAME`", mark)
        check_name(name.text, name.mark, "a rule")
        parts: list[Node] = [Atom("symbol", name.text, name.mark)]
        if priority := self._given.get("priority"):
            said = word(priority, "the priority", mark)
            if not re.fullmatch(r"-?\d+", said.text):
                raise said.mark.error("a priority is a whole number: the higher one goes first")
            parts.append(
                form("declare", form("salience", Atom("number", said.text, said.mark)), mark=said.mark)
            )
        when = items(self._given.get("when"), mark).items
        then = items(self._given.get("then"), mark).items
        if not when or not then:
            raise mark.error(f"rule {name.text} needs `when` and `then`")
        left = [node for given in when for node in self._condition(given)]
        right = [node for given in then for node in self._action(given)]
        parts += [*self._parameters(left, right), *left, Atom("symbol", "=>"), *right]
        return form("defrule", *parts, mark=mark), self._program

    def _parameters(self, left: Sequence[Node], right: Sequence[Node]) -> list[Node]:
        """Return a condition for each parameter that is used and that no condition gives another value."""
        used = {name for node in (*left, *right) for name in variables(node)}
        given = {
            name
            for node in left
            if isinstance(node, Form) and node.head not in {"test", "not"}
            for name in _plain_variables(node)
        }
        found: list[Node] = []
        for parameter in self._program.parameters:
            if parameter.name in used - given:
                name, variable = form("name", plain(parameter.name)), Atom("variable", f"?{parameter.name}")
                found.append(form(PARAMETER, name, form("value", variable), mark=self._given.mark))
        return found

    # -- when

    def _condition(self, given: Written) -> list[Node]:
        key, value, one = _only(given, "a condition", {"as"})
        if key.text == "if":
            said = word(value, "`if`", key.mark)
            return [form("test", formula(said.text, said.mark), mark=key.mark)]
        negated = key.text.startswith("no ")
        name = Word(key.text.removeprefix("no ").strip(), key.mark)
        pattern = self._pattern(name, value)
        if negated:
            if one.get("as") is not None:
                raise key.mark.error("what is not there cannot have a name (as)")
            return [form("not", pattern, mark=key.mark)]
        if (alias := one.get("as")) is not None:
            self._names.add((named := _variable(alias)).text)
            return [named, Atom("symbol", "<-", key.mark), pattern]
        return [pattern]

    def _pattern(self, name: Word, given: Written) -> Form:
        hears = next((hear for hear in self._program.hears if hear.name == name.text), None)
        if hears is not None:
            return self._heard(hears, name, given)
        if name.text in EVENTS:
            return self._event(name, given)
        if self._program.template(name.text) is None or name.text == MESSAGE:
            known = [template.name for template in self._program.templates] + [
                hear.name for hear in self._program.hears
            ]
            meant = nearest(name.text, [*known, *EVENTS, PARTNER, ROLE])
            raise name.mark.error(
                f"there is no fact or message {name.text!r}{meant}; "
                f"this script has: {', '.join(known) or 'none'}; "
                f"every script has: partner, parameter, role, {', '.join(EVENTS)}"
            )
        return form(
            name.text,
            *(
                form(slot.text, *self._wish(value), mark=slot.mark)
                for slot, value in entries(given, "the slots", name.mark)
            ),
            mark=name.mark,
        )

    def _wish(self, value: Written) -> list[Node]:
        self._number += 1
        return _wanted(value, self._number)

    def _heard(self, hears: Hears, name: Word, given: Written) -> Form:
        wishes = entries(given, "the message", name.mark)
        names = [part for part, _ in hears.parts]
        wishes.expect((*names, "from", "conversation", "reply by"), f"message {hears.name}")
        said = {key.text: value for key, value in wishes}
        args = [
            node
            for part in names
            for node in (self._wish(said[part]) if part in said else [Atom("variable", "?", name.mark)])
        ]
        return self._message(name.mark, said, form("act", plain(hears.name)), form("args", *args))

    def _message(self, mark: Mark, said: dict[str, Written], *slots: Node) -> Form:
        known = {"partner": "from", "from": "from", "conversation": "conv", "reply by": "by"}
        more = [form(slot, *self._wish(said[key])) for key, slot in known.items() if key in said]
        return form(MESSAGE, *slots, *more, mark=mark)

    def _event(self, name: Word, given: Written) -> Form:
        if name.text == "timer" and isinstance(given, Word):
            given = Entries(((Word("name", given.mark), given),), given.mark)
        if name.text in {"lost", "found", "stopped", "released"} and isinstance(given, Word) and given.text:
            given = Entries(((Word("partner", given.mark), given),), given.mark)
        wishes = entries(given, name.text, name.mark)
        wishes.expect(EVENTS[name.text], name.text)
        said = {key.text: value for key, value in wishes}
        if name.text == "answered" and "answer" in said:
            said["answer"] = _as_said(said["answer"])

        def wish(condition: str) -> list[Node]:
            return self._wish(said[condition]) if condition in said else [Atom("variable", "?")]

        def args(*names: str) -> Form:
            nodes = [node for condition in names for node in wish(condition)]
            while nodes and isinstance(last := nodes[-1], Atom) and last.text == "?":
                nodes.pop()
            return form("args", *nodes, Atom("variable", "$?"))

        match name.text:
            case "message":
                fields = (("performative", "perf"), ("act", "act"), ("arguments", "args"))
                slots = [form(slot, *self._wish(said[key])) for key, slot in fields if key in said]
            case "failed":
                slots = [form("perf", plain("failure")), form("act", *wish("act")), args("reason")]
            case event:
                slots = [form("act", plain(event))]
                slots += [args(*values)] if (values := values_of(event)) else []
                slots = [form("perf", plain("inform")), *slots] if event == "done" else slots
        return self._message(name.mark, said, *slots)

    # -- then

    def _named(self, given: Written) -> Atom:
        """Return the name of a fact that a condition has given."""
        found = _variable(given)
        if found.text not in self._names:
            name = found.text.removeprefix("?")
            known = ", ".join(sorted(one.removeprefix("?") for one in self._names)) or "none"
            raise given.mark.error(
                f"no condition is named {name}: write `as: {name}` below the condition; named are: {known}"
            )
        return found

    def _action(self, given: Written) -> list[Node]:
        key, value, one = _only(given, "an action", {"as", "with"})
        mark = key.mark
        if key.text != "do" and len(one.entries) > 1 and not (key.text == "ask" and one.get("with") is None):
            raise given.mark.error("only `do` has `with` and `as`, and `ask` has `as`")
        if key.text.startswith("update "):
            fact = self._named(Word(key.text.removeprefix("update ").strip(), mark))
            return [form("modify", fact, *_slots(value, mark), mark=mark)]
        match key.text:
            case "do":
                made = [self._do(mark, value, one)]
            case "ask":
                made = [_ask(mark, value, one.get("as"))]
            case "remember":
                facts = entries(value, "a fact", mark)
                made = [
                    form("assert", new_fact(Entries((fact,), mark), "a fact"), mark=mark) for fact in facts
                ]
            case "forget":
                made = [form("retract", *map(self._named, items(value, mark).items), mark=mark)]
            case "wait":
                made = [self._wait(mark, value)]
            case "role":
                made = [_role(mark, value)]
            case "reply" | "cancel" | "log" | "end" | "fail":
                made = [form(key.text, *map(_value, items(value, mark).items), mark=mark)]
            case other:
                meant = nearest(other, (*ACTIONS, "update"))
                raise mark.error(f"there is no action {other!r}{meant}; there are: {', '.join(ACTIONS)}")
        return [*made]

    def _do(self, mark: Mark, value: Written, one: Entries) -> Form:
        given = list(items(value, mark).items)
        if len(given) == 1 and isinstance(given[0], Word):
            partner, dot, act = given[0].text.partition(".")
            if not dot:
                raise mark.error("do is written as `do: PARTNER.ACT`, or `do: [PARTNER, ACT, value …]`")
            given = [Word(partner, given[0].mark), Word(act, given[0].mark)]
        named: list[Node] = []
        more = one.get("with")
        if given and isinstance(given[-1], Entries):
            more = given.pop()
        for key, argument in entries(more, "with", mark):
            named += [Atom("symbol", f"{check_argument(key)}=", key.mark), _value(argument)]
        values = [_value(each) for each in given]
        self._known(values, mark)
        if (tag := one.get("as")) is not None:
            return form("do-as", _value(tag), *values, *named, mark=mark)
        return form("do", *values, *named, mark=mark)

    def _known(self, values: Sequence[Node], mark: Mark) -> None:
        partner = values[0] if values else None
        names = [each.name for each in self._program.partners]
        if isinstance(partner, Atom) and partner.sort == "string" and partner.text not in names:
            known = ", ".join(names) or "none"
            meant = nearest(partner.text, names)
            raise mark.error(f"there is no partner {partner.text!r}{meant}; this script has: {known}")

    def _wait(self, mark: Mark, value: Written) -> Form:
        if isinstance(value, Entries):
            value.expect(("name", "for", "conversation"), "wait")
            given = [value.get("name"), value.get("for"), value.get("conversation")]
        else:
            given = [*items(value, mark).items, None, None][:3]
        name, seconds, conversation = given
        if name is None or seconds is None:
            raise mark.error("wait is written as `wait: {name: NAME, for: 5 s}`")
        said = word(seconds, "the time", mark)
        if (fixed := seconds_of(said.text)) is not None:
            number: Node = Atom("number", repr(fixed), said.mark)
        else:
            number = _value(said)
            default = next(
                (
                    parameter.default
                    for parameter in self._program.parameters
                    if said.text == f"${parameter.name}"
                ),
                0,
            )
            literal_text = isinstance(number, Atom) and number.sort != "variable"
            if literal_text or seconds_of(default) is None:
                shown = said.text if literal_text else f"{default} ({said.text})"
                raise said.mark.error(f"{shown!r} is no time: write it as `5 s` or `2 min`")
        rest = [] if conversation is None else [_value(conversation)]
        return form("wait", _value(name), number, *rest, mark=mark)


def _only(given: Written, what: str, beside: set[str]) -> tuple[Word, Written, Entries]:
    """Return the one thing that a condition or action says, and all of it; a bare word says no more."""
    if isinstance(given, Word):
        given = Entries(((given, Word("", given.mark)),), given.mark)
    one = entries(given, what, given.mark)
    rest = [(key, value) for key, value in one if key.text not in beside]
    if len(rest) != 1:
        raise given.mark.error(f"write {what} on a line of its own, beginning with `- `")
    return *rest[0], one


def _slots(given: Written, mark: Mark) -> list[Form]:
    return [
        form(slot.text, *map(_value, new.items if isinstance(new, Items) else (new,)), mark=slot.mark)
        for slot, new in entries(given, "the slots", mark)
    ]


def _as_said(given: Written) -> Written:
    """Return an answer of a person as a text: `yes` is one there, too."""
    return (
        Word(given.text, given.mark, quoted=True)
        if isinstance(given, Word) and given.text.isalpha()
        else given
    )


def _ask(mark: Mark, value: Written, tag: Written | None) -> Form:
    """Return a question to a person: a text alone, or `{question: …, answers: [yes, no]}`."""
    question: Word
    answers: Sequence[Written] = ()
    if isinstance(value, Word):
        question = value
    else:
        asked = entries(value, "a question", mark)
        asked.expect(("question", "answers"), "ask")
        question = word(asked.get("question"), "the question", mark)
        answers = items(asked.get("answers"), mark).items
    nodes = [_value(question), *(_value(_as_said(one)) for one in answers)]
    return form("ask", *nodes, mark=mark) if tag is None else form("ask-as", _value(tag), *nodes, mark=mark)


def _role(mark: Mark, given: Written) -> Form:
    pairs = given.entries if isinstance(given, Entries) else ()
    if len(pairs) != 1:
        raise mark.error("write `role: {PARTNER: ROLE}`; two roles at once cannot be played")
    return form("play", _value(pairs[0][0]), _value(pairs[0][1]), mark=mark)


def check_argument(key: Word) -> str:
    """Return the name of an argument of an act."""
    if not re.fullmatch(r"[a-z_]\w*", key.text):
        raise key.mark.error(f"{key.text!r} cannot be the name of an argument")
    return key.text


def _plain_variables(node: Node) -> list[str]:
    """Return the variables that a pattern gives a value: not those inside of its tests."""
    if isinstance(node, Atom):
        return [*variables(node)]
    return [
        name
        for slot in node.rest
        if isinstance(slot, Form)
        for part in slot.rest
        if isinstance(part, Atom)
        for name in variables(part)
    ]
