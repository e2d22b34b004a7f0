"""What a script says of others, compared with what is known of them: kinds, commands, arguments, roles. Pure.

A kind that is not known, a command that stands in `needs`, and a value that is computed are let through.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches

from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import CommandSpec
from robotree.vr.base.errors import BadArgument, BrokenScript
from robotree.vr.base.written import Mark
from robotree.vr.scripts.expression import Atom, Form, Node, value
from robotree.vr.scripts.program import MESSAGE, PARTNER, ROLE, Program, Rule
from robotree.vr.scripts.roles.profile import shipped

KnownKinds = Mapping[str, Mapping[str, CommandSpec]]
"""The commands of each kind, by name."""


def check_known(program: Program, kinds: KnownKinds) -> None:
    """Refuse a partner, command, argument, timer or role that cannot be meant.

    Raises:
        BrokenScript: there is one, and where.
    """
    waits = [one.rest[0] for rule in program.rules for one in _forms(rule.form) if one.head == "wait"]
    timers = None if any(isinstance(one, Form) or one.sort == "variable" for one in waits) else [
        one.text for one in waits if isinstance(one, Atom)
    ]  # fmt: skip
    for rule in program.rules:
        _Known(program, kinds, rule, timers).check()


class _Known:
    """Compares one rule."""

    def __init__(self, program: Program, kinds: KnownKinds, rule: Rule, timers: list[str] | None) -> None:
        self._partners = {one.name: one for one in program.partners}
        self._kinds, self._rule, self._timers = kinds, rule, timers

    def check(self) -> None:
        for form in _forms(self._rule.form):
            match form.head:
                case "do":
                    self._do(form.rest[0], form.rest[1], form.rest[2:])
                case "do-as":
                    self._do(form.rest[1], form.rest[2], form.rest[3:])
                case "play":
                    self._partner(form.rest[0])
                    self._role(form.rest[1])
                case head if head in {MESSAGE, PARTNER, ROLE}:
                    self._fact(form)
                case _:
                    pass

    def _fact(self, form: Form) -> None:
        slots = {one.head: one.rest for one in form.rest if isinstance(one, Form)}
        if form.head != MESSAGE:
            self._partner(_first(slots.get("name" if form.head == PARTNER else "partner", ())))
            if form.head == ROLE:
                self._role(_first(slots.get("name", ())))
            return
        act, sender = _first(slots.get("act", ())), _first(slots.get("from", ()))
        first = _first(slots.get("args", ()))
        failed = _constant(_first(slots.get("perf", ()))) == "failure"
        told = _constant(act)
        if failed or told in {"done", "progress", "lost", "found", "stopped", "released"}:
            self._partner(sender)
        if failed or told in {"done", "progress"}:
            self._act(sender, act if failed else first)
        elif told == "timer" and self._timers is not None:
            self._one_of(first, self._timers, "no rule waits for the timer", "the rules wait for")

    def _do(self, partner: Node, act: Node, values: tuple[Node, ...]) -> None:
        self._partner(partner)
        self._act(partner, act)
        known = self._partners.get(_constant(partner) or "")
        spec = None if known is None else self._kinds.get(known.kind, {}).get(_constant(act) or "")
        if spec is None:
            return
        names, at, given = [*spec.by_name], 0, set[str]()
        while at < len(values):
            one = values[at]
            if isinstance(one, Atom) and one.sort == "symbol" and one.text.endswith("="):
                name, at = one.text[:-1], at + 1
                if name not in spec.by_name:
                    raise self._error(one, f"{spec.name} has no argument {name!r}", names, name, "it takes")
            elif len(given) >= len(names):
                raise self._mark(one).error(f"{spec.name} takes {len(names)} values: {', '.join(names)}")
            else:
                name = names[len(given)]
            given.add(name)
            if at < len(values):
                self._argument(spec, name, values[at])
            at += 1
        if lacks := [one.name for one in spec.parameters if one.required and one.name not in given]:
            raise self._mark(act).error(f"{spec.name} needs {', '.join(lacks)}")

    def _argument(self, spec: CommandSpec, name: str, given: Node) -> None:
        if isinstance(given, Form) or given.sort == "variable":
            return
        try:
            check_argument(spec.by_name[name], value(given), command=spec.name)
        except BadArgument as error:
            raise self._mark(given).error(str(error)) from None

    def _partner(self, given: Node | None) -> None:
        self._one_of(given, self._partners, "there is no partner", "this script has")

    def _act(self, partner: Node | None, act: Node | None) -> None:
        name = _constant(partner)
        chosen = [one for one in self._partners.values() if name is None or one.name == name]
        if any(one.kind not in self._kinds for one in chosen):
            return
        known = [command for one in chosen for command in (*self._kinds[one.kind], *one.needs)]
        said = f"a {chosen[0].kind} has no command" if len(chosen) == 1 else "no partner has the command"
        self._one_of(act, [*dict.fromkeys([*known, "play"])], said, "there are")

    def _role(self, given: Node | None) -> None:
        """Refuse what is nearly the name of a role; a robot may have learned others."""
        name, known = _constant(given), [*shipped(), "neutral"]
        if name is not None and name not in known and get_close_matches(name, known, n=1):
            self._one_of(given, known, "there is no role", "there are")

    def _one_of(self, given: Node | None, known: Iterable[str], said: str, others: str) -> None:
        name = _constant(given)
        if given is not None and name is not None and name not in (names := [*known]):
            raise self._error(given, f"{said} {name!r}", names, name, others)

    def _error(self, at: Node, said: str, known: list[str], name: str, others: str) -> BrokenScript:
        near = get_close_matches(name, known, n=1)
        meant = f"; do you mean {near[0]!r}?" if near else ""
        return self._mark(at).error(f"{said}{meant}; {others}: {', '.join(known) or 'none'}")

    def _mark(self, at: Node) -> Mark:
        return at.mark if at.mark.line else self._rule.mark


def _forms(form: Form) -> Iterator[Form]:
    yield form
    for part in form.parts:
        if isinstance(part, Form):
            yield from _forms(part)


def _first(parts: tuple[Node, ...]) -> Node | None:
    return parts[0] if parts else None


def _constant(node: Node | None) -> str | None:
    return node.text if isinstance(node, Atom) and node.sort in {"symbol", "string"} else None
