"""Scripts for experts: CLIPS text, behind the guard. Pure.

(defscript guide "Greets visitors."
  (partner robot (kind Companion) (needs say go_to) (attributes place=hall) (takes place kitchen)
    (optional) (return 300)
    (choose free) (where "battery > 30"))
  (partner rovers (kind Rover) (count 2) (group cleaners)) ; an act of it is one of each, (act answer) an end
  (parameter greeting "Welcome")
  (hears person_seen (who text) (place text))
  (starts-by anna kim)       ; none: anyone
  (starts-itself))
(deftemplate visitor (slot id) (slot stage (default waiting)))
(deffacts begin (visitor (id nobody)))
(defrule greet (msg (act person_seen) (args ?who ?place)) => (do robot say "Welcome"))
"""

from __future__ import annotations

from typing import Any

import msgspec

from robotree.vr.base.address import check_name as check_agent_name
from robotree.vr.base.errors import RequirementUnreadable, VrError
from robotree.vr.base.written import Mark, Scalar, Word
from robotree.vr.core.bonds import LONGEST_RETURN
from robotree.vr.scripts.expression import Atom, Form, Node, read, value
from robotree.vr.scripts.guard import Guard, named
from robotree.vr.scripts.program import (
    MOST_RULES,
    MOST_TOGETHER,
    SYSTEM,
    FactTemplate,
    Hears,
    Parameter,
    Partner,
    Program,
    Rule,
    ScriptSlot,
    check_identifier,
    check_name,
)
from robotree.vr.scripts.requirement import requirement

TYPES = ("text", "number", "yes/no")


def read_clp(source: str, path: str, name: str) -> Program:
    """Read a script.

    Args:
        source: its text.
        path: where its author keeps it.
        name: of the script when it has no `defscript`.

    Raises:
        BrokenScript: it says something that no script may say, and where.
    """
    program = Program(name=name, path=path, source=source)
    facts: list[Form] = []
    rules: dict[str, Rule] = {}
    for construct in read(source, path):
        match construct.head:
            case "defscript":
                program = _head(program, construct)
            case "deftemplate":
                program = with_template(program, _template(construct))
            case "deffacts":
                _, _, rest = named(construct, "a list of facts")
                facts += [first_fact(fact, program) for fact in rest]
            case "defrule":
                add_rule(rules, construct, program)
            case head:
                known = "defscript, deftemplate, deffacts, defrule"
                raise construct.mark.error(f"({head or '…'} …) cannot stand here; a script has: {known}")
    return msgspec.structs.replace(program, facts=tuple(facts), rules=tuple(rules.values()))


def add_rule(rules: dict[str, Rule], construct: Form, program: Program) -> Rule:
    """Check a rule and add it to those before it."""
    built, conditions, doc = Guard(program.template).rule(construct)
    first = built.rest[0]
    name = first.text if isinstance(first, Atom) else ""
    if name in rules:
        raise construct.mark.error(f"there are two rules named {name}")
    if len(rules) >= MOST_RULES:
        raise construct.mark.error(f"there are more than {MOST_RULES} rules; make several scripts of it")
    rules[name] = Rule(name=name, form=built, conditions=conditions, mark=construct.mark, doc=doc)
    return rules[name]


def with_template(program: Program, template: FactTemplate) -> Program:
    """Return the program with one more kind of fact."""
    if program.template(template.name) is not None:
        own = any(one.name == template.name for one in SYSTEM)
        why = "every script has it already" if own else "it is declared twice"
        raise template.mark.error(f"fact {template.name}: {why}")
    return msgspec.structs.replace(program, templates=(*program.templates, template))


def first_fact(fact: Node, program: Program) -> Form:
    """Check a fact with which a script begins."""
    if not isinstance(fact, Form):
        raise fact.mark.error("a fact stands in brackets")
    rule = Form(
        (
            Atom("symbol", "defrule"),
            Atom("symbol", "first"),
            Atom("symbol", "=>"),
            Form((Atom("symbol", "assert"), fact)),
        )
    )
    built, _, _ = Guard(program.template).rule(rule)
    asserted = built.parts[3]
    assert isinstance(asserted, Form)  # noqa: S101 # as it was put in
    checked = asserted.rest[0]
    assert isinstance(checked, Form)  # noqa: S101 # as it was put in
    for slot in checked.rest:
        for one in slot.rest if isinstance(slot, Form) else ():
            value(one)
    return checked


def _template(construct: Form) -> FactTemplate:
    name, doc, rest = named(construct, "a fact")
    slots: list[ScriptSlot] = []
    for part in rest:
        if not isinstance(part, Form) or part.head not in {"slot", "multislot"} or not part.rest:
            raise part.mark.error("a fact has (slot NAME (default VALUE)) and (multislot NAME)")
        first = part.rest[0]
        if not isinstance(first, Atom) or first.sort != "symbol":
            raise part.mark.error("a slot needs a name")
        check_name(first.text, first.mark, "a slot")
        if any(slot.name == first.text for slot in slots):
            raise first.mark.error(f"slot {first.text} stands here twice")
        several = part.head == "multislot"
        default: Scalar | None = None
        for facet in part.rest[1:]:
            if not isinstance(facet, Form) or facet.head != "default" or len(facet.rest) != 1 or several:
                raise facet.mark.error("of the facets of a slot only (default VALUE) can be used")
            default = value(facet.rest[0])
        slots.append(ScriptSlot(name=first.text, several=several, default=default))
    return FactTemplate(name=name.text, slots=tuple(slots), doc=doc, mark=construct.mark)


def _head(program: Program, construct: Form) -> Program:
    name, doc, rest = named(construct, "a script")
    partners: list[Partner] = []
    parameters: list[Parameter] = []
    hears: list[Hears] = []
    starters: tuple[str, ...] = ()
    itself = False
    for part in rest:
        if not isinstance(part, Form):
            raise part.mark.error("the head of a script is made of brackets")
        match part.head:
            case "partner":
                partners.append(_partner(part))
            case "parameter":
                first = _first(part, "a parameter")
                if len(part.rest) not in {2, 3}:
                    raise part.mark.error("write (parameter NAME DEFAULT)")
                note = str(value(part.rest[2])) if len(part.rest) == 3 else ""
                parameters.append(Parameter(name=first, default=value(part.rest[1]), doc=note))
            case "hears":
                hears.append(Hears(name=_first(part, "a message"), parts=tuple(map(_part, part.rest[1:]))))
            case "starts-by":
                starters = tuple(str(value(one)) for one in part.rest)
            case "starts-itself":
                itself = True
            case head:
                known = "partner, parameter, hears, starts-by, starts-itself"
                raise part.mark.error(f"a script has no ({head or '…'} …); it has: {known}")
    check_head(partners, parameters, hears, construct.mark)
    return msgspec.structs.replace(
        program,
        name=name.text,
        doc=doc,
        partners=tuple(partners),
        parameters=tuple(parameters),
        hears=tuple(hears),
        starters=starters,
        itself=itself,
    )


def check_head(partners: list[Partner], parameters: list[Parameter], hears: list[Hears], mark: Mark) -> None:
    """Refuse names that the script's robot could not tell apart."""
    seen: set[str] = set()
    slots = [slot for partner in partners for slot in {partner.name, *partner.slots}]
    for name in slots + [hear.name for hear in hears]:
        if name in seen:
            raise mark.error(f"{name!r} is declared twice")
        seen.add(name)
    names = [parameter.name for parameter in parameters]
    if len(names) != len(set(names)):
        raise mark.error("a parameter is declared twice")


def _first(part: Form, what: str) -> str:
    first = part.rest[0] if part.rest else None
    if not isinstance(first, Atom) or first.sort != "symbol":
        raise part.mark.error(f"{what} needs a name")
    return check_identifier(first.text, first.mark, what)


def _part(node: Node) -> tuple[str, str]:
    kind = node.rest[0] if isinstance(node, Form) and len(node.rest) == 1 else None
    if not isinstance(node, Form) or not isinstance(kind, Atom) or kind.text not in TYPES:
        raise node.mark.error(f"write an argument as (NAME TYPE); the types are: {', '.join(TYPES)}")
    return check_identifier(node.head, node.mark, "an argument"), kind.text


def _partner(part: Form) -> Partner:
    partner = Partner(name=_first(part, "a partner"), kind="")
    for facet in part.rest[1:]:
        if not isinstance(facet, Form):
            raise facet.mark.error("write (partner NAME (kind KIND) (needs COMMAND …))")
        partner = msgspec.structs.replace(partner, **_facet(facet, partner.takes))
    check_watched(partner, part.mark)
    if not partner.kind:
        raise part.mark.error(f"partner {partner.name} needs a kind: (kind Arm)")
    if partner.where and not partner.choose:
        raise part.mark.error(f"partner {partner.name} has a where: write (choose free), too")
    groups = [
        one.rest[0] for one in part.rest[1:] if isinstance(one, Form) and one.head == "group" and one.rest
    ]
    return of_group(partner, Word(str(value(groups[0])), part.mark)) if groups else partner


def _facet(facet: Form, takes: dict[str, tuple[str, ...]]) -> dict[str, Any]:  # noqa: PLR0911 # one each
    """Return what one facet says of a partner, by the name of the field."""
    values = [str(value(one)) for one in facet.rest]
    match facet.head:
        case "choose" | "where" if len(values) == 1:
            choose, where = (values[0] if facet.head == each else "" for each in ("choose", "where"))
            check_choice(Word(choose or FREE, facet.mark), Word(where, facet.mark))
            return {facet.head: values[0]}
        case "count" if len(values) == 1:
            return {"count": check_count(Word(values[0], facet.mark))}
        case "group" if len(values) == 1:
            return {}
        case "kind" | "doc" if len(values) == 1:
            return {facet.head: values[0]}
        case "needs":
            return {"needs": tuple(values)}
        case "attributes":
            pairs = (one.partition("=") for one in values)
            return {"attributes": {key: wanted for key, _, wanted in pairs}}
        case "takes" if len(values) > 1:
            return {"takes": {**takes, values[0]: tuple(values[1:])}}
        case "return" if len(values) == 1:
            return {"returns": _return(facet)}
        case "optional" | "watch" if not values:
            return {"optional" if facet.head == "optional" else "watched": True}
        case head:
            raise facet.mark.error(
                f"a partner has no ({head} …); it has: kind, needs, attributes, takes, optional, "
                "return, watch, choose, where, count, group, doc"
            )


def _return(facet: Form) -> float:
    seconds = value(facet.rest[0])
    if isinstance(seconds, bool) or not isinstance(seconds, int | float):
        raise facet.mark.error(f"write the time of {facet.head} in seconds: (return 300)")
    return check_return(float(seconds), facet.mark)


FREE = "free"
"""The one way to choose a partner."""


def check_choice(choose: Word, where: Word) -> None:
    """Refuse a choice of a partner that cannot be made.

    Raises:
        BrokenScript: there is no such way, nobody to choose, or `where` cannot be read.
    """
    if choose.text not in {"", FREE}:
        raise choose.mark.error(f"{choose.text!r} is no way to choose a partner: write free")
    if where.text and not choose.text:
        raise where.mark.error("a partner with a where is chosen: write choose: free, too")
    try:
        requirement(where.text)
    except RequirementUnreadable as error:
        raise where.mark.error(str(error)) from None


def check_watched(partner: Partner, mark: Mark) -> None:
    """Refuse what cannot be had of a partner that is only watched.

    Raises:
        BrokenScript: it is wanted.
    """
    if partner.watched and (partner.needs or partner.choose or partner.returns or partner.takes):
        raise mark.error(f"partner {partner.name} is only watched: it has no needs, takes, return and choose")


def check_count(count: Word) -> int:
    """Return how many robots a partner is.

    Raises:
        BrokenScript: it is no such number.
    """
    if not (count.text.isdecimal() and 1 <= int(count.text) <= MOST_TOGETHER):
        raise count.mark.error(f"{count.text!r} is no number of robots: write one from 1 to {MOST_TOGETHER}")
    return int(count.text)


def of_group(partner: Partner, group: Word) -> Partner:
    """Return a partner whose robots are chosen among the members of a group of the realm.

    Raises:
        BrokenScript: it is not said how many, or no group can have that name.
    """
    if not partner.count:
        raise group.mark.error(f"partner {partner.name} is of group {group.text}: say how many, `count: 2`")
    try:
        check_agent_name(group.text)
    except VrError as error:
        raise group.mark.error(str(error)) from None
    rule = f"in '{group.text}'"
    where = f"({partner.where}) and {rule}" if partner.where else rule
    return msgspec.structs.replace(partner, choose=FREE, where=where)


def check_return(seconds: float, mark: Mark) -> float:
    """Return the time [s] in which a partner may come back.

    Raises:
        BrokenScript: it is too long.
    """
    if not 0.0 < seconds <= LONGEST_RETURN:
        raise mark.error(
            f"a partner can return within {LONGEST_RETURN / 60:g} min at most; give a time above 0"
        )
    return seconds
