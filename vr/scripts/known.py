"""A script's statements on others, compared with their descriptions: kinds, commands, arguments, roles. Pure.

A kind that is not known, a command that stands in `needs`, and a value that is computed are let through.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from difflib import get_close_matches
from types import MappingProxyType

from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import CommandSpec
from robotree.vr.base.errors import BadArgument, BrokenScript
from robotree.vr.base.written import Mark, Word, value_of
from robotree.vr.scripts.expression import Atom, Form, Node, plain, value
from robotree.vr.scripts.happening import nearest
from robotree.vr.scripts.program import CHOICE, MESSAGE, PARTNER, READING, ROLE, Partner, Program, literal
from robotree.vr.scripts.roles.profile import shipped
from robotree.vr.scripts.trial import CHANGES, Trial, happening, words_of

ORDERS = ("do", "ask", "reply", "wait", "cancel", "role", "log", "end", "fail")
"""The first words of orders in a table of tests."""
_NAMED = re.compile(r"[a-z_]\w*=")
KnownKinds = Mapping[str, Mapping[str, CommandSpec]]
"""The commands of each kind, by name."""
KnownStreams = Mapping[str, Collection[str]]
"""Names of the streams of each kind."""


def check_known(program: Program, kinds: KnownKinds, streams: KnownStreams = MappingProxyType({})) -> None:
    """Refuse a partner, command, argument, timer, reading or role that cannot be meant.

    Raises:
        BrokenScript: there is one, and where.
    """
    for rule in program.rules:
        _Known(program, kinds, rule.mark, streams).check(rule.form)


def mistyped(program: Program, kinds: Collection[str]) -> list[tuple[Partner, str]]:
    """Return the partners whose kind is nearly that of a known one, and a hint; a page may bring the kind."""
    unknown = (partner for partner in program.partners if partner.kind and partner.kind not in kinds)
    return [(partner, near) for partner in unknown if (near := nearest(partner.kind, kinds))]


def check_trials(program: Program, trials: Iterable[Trial], kinds: KnownKinds) -> None:
    """Refuse the same in a table of tests: in what happens, in the orders that must follow, in roles.

    Raises:
        BrokenScript: there is one, and where.
    """
    for trial in trials:
        for name, role in trial.roles.items():
            _Known(program, kinds, trial.mark).plays(name, role)
        for step in trial.steps:
            known = _Known(program, kinds, step.mark)
            known.happening(step.when)
            for line in step.then or ():
                known.order(line)


class _Known:
    """Compares one rule, or one step of a test."""

    def __init__(
        self,
        program: Program,
        kinds: KnownKinds,
        mark: Mark,
        streams: KnownStreams = MappingProxyType({}),
    ) -> None:
        """Take what there is to compare with, and the place of what has none of its own."""
        self._program, self._kinds, self._streams, self._default = program, kinds, streams, mark
        self._partners = {partner.name: partner for partner in program.partners}
        waits = [form.rest[0] for rule in program.rules for form in _forms(rule.form) if form.head == "wait"]
        computed = any(isinstance(wait, Form) or wait.sort == "variable" for wait in waits)
        self._timers = None if computed else [wait.text for wait in waits if isinstance(wait, Atom)]

    def plays(self, partner: str, role: str) -> None:
        """Check that there is such a partner, and perhaps such a role."""
        self._partner(plain(partner))
        self._role(plain(role))

    def happening(self, line: str) -> None:
        """Check one line of what happens."""
        event = happening(line, self._default)
        match line.split(maxsplit=1)[0]:
            case "done" | "progress":
                self._partner(plain(event.sender))
                self._act(plain(event.sender), plain(str(event.arguments[0])))
            case "failed":
                self._partner(plain(event.sender))
                self._act(plain(event.sender), plain(event.act))
            case "role":
                self.plays(event.sender, str(event.arguments[0]))
            case head if head in CHANGES or head == "reading":
                self._partner(plain(event.sender))
            case "timer":
                self._timer(plain(str(event.arguments[0])))
            case _:
                pass

    def order(self, line: str) -> None:
        """Check one order that must follow."""
        head, *rest = words_of(line, self._default)
        if head not in ORDERS:
            names = ", ".join(ORDERS)
            raise self._default.error(f"{head!r} is no order{nearest(head, ORDERS)}; there are: {names}")
        if head == "do" and len(rest) >= 2:
            self._do(plain(rest[0]), plain(rest[1]), tuple(_given(rest[2:])))
        elif head == "role" and len(rest) == 2:
            self.plays(*rest)
        elif head == "wait" and rest:
            self._timer(plain(rest[0]))

    def check(self, rule: Form) -> None:
        """Check a rule."""
        for form in _forms(rule):
            match form.head:
                case "do":
                    self._do(form.rest[0], form.rest[1], form.rest[2:])
                case "do-as":
                    self._do(form.rest[1], form.rest[2], form.rest[3:])
                case "play":
                    self._partner(form.rest[0])
                    self._role(form.rest[1])
                case head if head in {MESSAGE, PARTNER, ROLE, READING, CHOICE}:
                    self._fact(form)
                case _:
                    pass

    def _fact(self, form: Form) -> None:
        slots = {one.head: one.rest for one in form.rest if isinstance(one, Form)}
        if form.head != MESSAGE:
            self._partner(_first(slots.get("name" if form.head == PARTNER else "partner", ())))
            if form.head == CHOICE:
                self._choice(slots)
            if form.head == ROLE:
                self._role(_first(slots.get("name", ())))
            if form.head == READING:
                self._reading(slots)
            return
        act, sender = _first(slots.get("act", ())), _first(slots.get("from", ()))
        first = _first(slots.get("args", ()))
        failed = _constant(_first(slots.get("perf", ()))) == "failure"
        name = _constant(act)
        if failed or name in {"done", "progress", "lost", "found", "stopped", "released"}:
            self._partner(sender)
        if failed or name in {"done", "progress"}:
            self._act(sender, act if failed else first)
        elif name == "timer":
            self._timer(first)

    def _timer(self, given: Node | None) -> None:
        if self._timers is not None:
            self._one_of(given, self._timers, "no rule waits for the timer", "the rules wait for")

    def _do(self, partner: Node, act: Node, values: tuple[Node, ...]) -> None:
        self._partner(partner)
        meant = self._partners.get(_constant(partner) or "")
        if meant is not None and meant.watched:
            raise self._mark(partner).error(f"{meant.name} is only watched, and is asked nothing")
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
            if at < len(values) and known is not None:
                self._argument(spec, name, values[at], known.takes.get(name, ()))
            at += 1
        if lacks := [
            parameter.name
            for parameter in spec.parameters
            if parameter.required and parameter.name not in given
        ]:
            raise self._mark(act).error(f"{spec.name} needs {', '.join(lacks)}")

    def _argument(self, spec: CommandSpec, name: str, given: Node, also: tuple[str, ...]) -> None:
        if isinstance(given, Form) or given.sort == "variable":
            return
        said, field = value(given), spec.by_name[name]
        if said in also:
            return
        try:
            check_argument(field, said, command=spec.name)
        except BadArgument as error:
            text = str(error)
            if field.choices:
                meant = nearest(str(said), [*field.choices, *also])
                text += f"{meant}; if your robot takes it, write `takes: {{{name}: [{said}]}}` at the partner"
            raise self._mark(given).error(text) from None

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
        if name is None or name in known or "-" in name:  # as `desk-butler`, which a service lends
            return
        if get_close_matches(name, known, n=1):
            self._one_of(given, known, "there is no role", "there are")

    def _reading(self, slots: Mapping[str, tuple[Node, ...]]) -> None:
        """Refuse a stream of a partner: rules have its readings only."""
        partner, given = _constant(_first(slots.get("partner", ()))), _first(slots.get("name", ()))
        chosen = self._partners.get(partner or "")
        name = _constant(given)
        if chosen is not None and given is not None and name in self._streams.get(chosen.kind, ()):
            raise self._mark(given).error(
                f"{name} is a stream of {chosen.name}, and no reading: a page with Watch(…) reads it"
            )

    def _choice(self, slots: Mapping[str, tuple[Node, ...]]) -> None:
        """Refuse an argument that no command of a partner takes."""
        partner = _constant(_first(slots.get("partner", ())))
        chosen = [one for one in self._partners.values() if partner in {None, one.name}]
        if all(one.kind in self._kinds and not one.needs for one in chosen):
            specs = (spec for one in chosen for spec in self._kinds[one.kind].values())
            names = [field.name for spec in specs for field in spec.parameters if field.choices]
            self._one_of(_first(slots.get("argument", ())), dict.fromkeys(names), "no act takes", "they take")

    def _one_of(self, given: Node | None, known: Iterable[str], said: str, others: str) -> None:
        name = _constant(given)
        if given is not None and name is not None and name not in (names := [*known]):
            raise self._error(given, f"{said} {name!r}", names, name, others)

    def _error(self, at: Node, said: str, known: list[str], name: str, others: str) -> BrokenScript:
        return self._mark(at).error(f"{said}{nearest(name, known)}; {others}: {', '.join(known) or 'none'}")

    def _mark(self, at: Node) -> Mark:
        return at.mark if at.mark.line else self._default


def _given(words: Iterable[str]) -> Iterator[Node]:
    """Return the values of an order in a table: `text="Good day"`, or a value alone."""
    for word in words:
        found = _NAMED.match(word)
        if found:
            yield Atom("symbol", found.group())
        yield literal(value_of(Word(word[found.end() :] if found else word, Mark())))


def _forms(form: Form) -> Iterator[Form]:
    yield form
    for part in form.parts:
        if isinstance(part, Form):
            yield from _forms(part)


def _first(parts: tuple[Node, ...]) -> Node | None:
    return parts[0] if parts else None


def _constant(node: Node | None) -> str | None:
    return node.text if isinstance(node, Atom) and node.sort in {"symbol", "string"} else None
