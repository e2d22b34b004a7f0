"""How a page calls its children, as its tree says: commands that a kind lacks, and wrong arguments. Pure.

A child is `self.arm`, `self.rovers[0]`, or a name that stands for nothing else in its function:

    arm = self.arm
    for rover in self.rovers: …
    for index, rover in self.rovers.items(): …

What a page asks of others is read from the same tree: the permissions of its manifest, unless it names them.
`self.arm.move(…)` with `arm = Child("Arm")` needs `Arm.move`. What cannot be seen needs more: a slot that is
handed on as a value needs `Arm.*`, and a class whose base is not in the page, or a script, everything.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any, NamedTuple

from robotree.vr.author.child import WITHIN
from robotree.vr.author.fitting import READINGS
from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import CommandSpec, offered
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.permissions import ALL, ANY, EVERYTHING, Permissions
from robotree.vr.base.units import Unit, convert
from robotree.vr.bundle.reading import ROOT, Finding, Function, Page, dotted, last, pages_of
from robotree.vr.bundle.syntax import parse

Kinds = Mapping[str, Mapping[str, CommandSpec | None]]
"""The commands of kinds of robots, by name of the kind."""
OF_EVERY_CHILD = frozenset({"set", READINGS})
"""Names that work for children of all kinds."""
OF_A_GROUP = frozenset({"items"})
"""The methods of a group of children beside their commands."""
MANNERS = frozenset({"start", "tell"})
"""How a command of a child can be called, beside directly."""
_UNKNOWN: Any = object()


class _Command(NamedTuple):
    """A command of a child, as an expression of the page names it."""

    slot: str
    name: str
    node: ast.Attribute


def of_children(page: Page, kinds: Kinds) -> Iterator[Finding]:
    """Find commands that the kind of a slot lacks, and arguments that a command does not take.

    Args:
        page: whose slots these are.
        kinds: that are known.
    """
    for slot, command, call in page.exposed:
        yield from _lacks(page, slot, command, call.lineno, kinds)
        yield from _wrong_units(slot, _spec(page, slot, command, kinds), command, call)
    for method in page.methods:
        yield from _Calls(page, method, kinds).findings()


class _Calls:
    """The calls of one method."""

    def __init__(self, page: Page, method: Function, kinds: Kinds) -> None:
        self._page, self._method, self._kinds = page, method, kinds
        self._names = dict(_names(page, method))

    def findings(self) -> Iterator[Finding]:
        """Yield what is wrong, in no order."""
        for node in ast.walk(self._method):
            if isinstance(node, ast.Attribute) and (command := self._command(node)):
                yield from self._of_name(command)
            elif isinstance(node, ast.Call):
                yield from self._of_call(node)

    def _command(self, node: ast.expr) -> _Command | None:
        """Return the command that an expression names: `self.arm.go_to`."""
        if not isinstance(node, ast.Attribute) or node.attr.startswith("_"):
            return None
        slot, _ = self._child(node.value)
        return _Command(slot, node.attr, node) if slot else None

    def _child(self, node: ast.expr) -> tuple[str, bool]:
        """Return the slot of the child that an expression is, or "", and whether it is a whole group."""
        if isinstance(node, ast.Name):
            return self._names.get(node.id, ""), False
        return _direct(self._page, node)

    def _of_name(self, command: _Command) -> Iterator[Finding]:
        slot, name, node = command
        group = self._child(node.value)[1]
        if group and name in OF_A_GROUP:
            return
        if group and name in {"values", "keys"}:
            what = f"self.{slot} has no {name}()"
            yield Finding(node.lineno, what, f"write for child in self.{slot}, or self.{slot}.items()")
            return
        yield from _lacks(self._page, slot, name, node.lineno, self._kinds)

    def _of_call(self, node: ast.Call) -> Iterator[Finding]:
        """Look at the arguments of `self.arm.go_to(…)`, `.start(…)` and `both.start(self.arm.go_to)`."""
        function, given = node.func, node.args
        if isinstance(function, ast.Attribute) and function.attr in MANNERS:
            if command := self._command(function.value):
                yield from self._of_arguments(command, given, node.keywords)
            elif given and (command := self._command(given[0])):
                yield from self._of_arguments(command, given[1:], node.keywords)
        elif command := self._command(function):
            yield from self._of_arguments(command, given, node.keywords)

    def _of_arguments(
        self, command: _Command, values: list[ast.expr], named: list[ast.keyword]
    ) -> Iterator[Finding]:
        spec = _spec(self._page, command.slot, command.name, self._kinds)
        if spec is None:
            return
        if any(isinstance(value, ast.Starred) for value in values) or any(one.arg is None for one in named):
            return
        label, line = f"{command.slot}.{command.name}", command.node.lineno
        takes = f"it takes: {', '.join(spec.by_name) or 'nothing'}"
        if len(values) > len(spec.parameters):
            yield Finding(line, f"{label} is given {len(values)} values", takes)
            return
        given: dict[str, ast.expr] = dict(zip(spec.by_name, values, strict=False))
        for one in named:
            name = str(one.arg)
            if name == WITHIN and name not in spec.by_name:
                continue
            if name in given:
                yield Finding(line, f"{label} is given {name} twice", takes)
            elif name not in spec.by_name:
                near = get_close_matches(name, spec.by_name, n=1)
                instead = f"did you mean {near[0]}?" if near else takes
                yield Finding(line, f"{label} has no parameter {name!r}", instead)
            given[name] = one.value
        for name in (field.name for field in spec.parameters if field.required and field.name not in given):
            yield Finding(line, f"{label} needs {name}", takes)
        yield from _wrong_values(spec, given, label, line)


def _wrong_values(
    spec: CommandSpec, given: Mapping[str, ast.expr], label: str, line: int
) -> Iterator[Finding]:
    """Find literals that a command refuses."""
    for field in spec.parameters:
        value = _constant(given.get(field.name))
        if value is not _UNKNOWN:
            try:
                check_argument(field, value, command=label)
            except BadArgument as error:
                yield Finding(line, f"{label}: {field.name}", str(error.data["reason"]))


def _names(page: Page, method: Function) -> Iterator[tuple[str, str]]:
    """Yield the names that stand for the child of one slot wherever the method binds them, with the slot."""
    bound: dict[str, list[str]] = {}
    times: Counter[str] = Counter()
    for node in ast.walk(method):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            times[node.id] += 1
        elif isinstance(node, ast.arg):
            times[node.arg] += 1
        names: dict[str, str] = {}
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                slot, group = _direct(page, value)
                names = {} if group else {name: slot}
            case ast.For(target=target, iter=source) | ast.comprehension(target=target, iter=source):
                names = _of_loop(page, target, source)
            case _:
                pass
        for name, slot in names.items():
            bound.setdefault(name, []).append(slot)
    for name, slots in bound.items():
        if len(set(slots)) == 1 and len(slots) == times[name] and slots[0]:
            yield name, slots[0]


def _of_loop(page: Page, target: ast.expr, source: ast.expr) -> dict[str, str]:
    """Return the names that a loop over a group gives to its children."""
    match target, source:
        case ast.Name(id=name), _:
            slot, group = _direct(page, source)
            return {name: slot if group else ""}
        case ast.Tuple(elts=[_, ast.Name(id=name)]), ast.Call(func=function, args=[*given]):
            if isinstance(function, ast.Attribute) and function.attr == "items":
                slot, group = _direct(page, function.value)
            else:
                counts = dotted(function) == "enumerate" and len(given) > 0
                slot, group = _direct(page, given[0]) if counts else ("", False)
            return {name: slot if group else ""}
        case _:
            return {}


def _direct(page: Page, node: ast.expr) -> tuple[str, bool]:
    """Return the slot in `self.arm` or `self.rovers[0]`, or "", and whether it is a whole group."""
    if isinstance(node, ast.Subscript):
        slot, group = _direct(page, node.value)
        return (slot, False) if group and not isinstance(node.slice, ast.Slice) else ("", False)
    if isinstance(node, ast.Attribute) and dotted(node.value) == "self" and node.attr in page.slots:
        return node.attr, node.attr in page.groups
    return "", False


def _spec(page: Page, slot: str, command: str, kinds: Kinds) -> CommandSpec | None:
    known = kinds.get(page.slots.get(slot, ""))
    return None if known is None else known.get(command)


def _lacks(page: Page, slot: str, command: str, line: int, kinds: Kinds) -> Iterator[Finding]:
    kind = page.slots.get(slot, "")
    known = kinds.get(kind)
    if known is not None and command not in known and command not in OF_EVERY_CHILD:
        what = f"{slot} is of kind {kind}, which has no command {command!r}"
        yield Finding(line, what, f"it has: {offered(sorted(known), command)}")


def _wrong_units(slot: str, spec: CommandSpec | None, command: str, call: ast.Call) -> Iterator[Finding]:
    """Find units of an exposed command that measure something else than the child's."""
    if spec is None:
        return
    units = {field.name or "result": field.unit for field in (*spec.parameters, *spec.result)}
    for given in call.keywords:
        match given.value:
            case ast.Call(func=function, args=[ast.Constant(value=str(symbol))]) if last(function) == "Unit":
                pass
            case _:
                continue
        own = units.get(str(given.arg), "")
        if not own:
            numbers = ", ".join(name for name, unit in units.items() if unit) or "none"
            what = f"{slot}.{command} has no {given.arg!r} with a unit"
            yield Finding(given.value.lineno, what, f"those with a unit are: {numbers}")
            continue
        try:
            Unit(symbol)
            convert(1.0, symbol, own)
        except ValueError as error:
            yield Finding(given.value.lineno, f"{slot}.{command}: {given.arg}", str(error))


def _constant(node: ast.expr | None) -> Any:
    """Return the value of a literal; `_UNKNOWN`: it is none."""
    if node is None:
        return _UNKNOWN
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return _UNKNOWN


def needs(source: str, wanted: str = "") -> Permissions:
    """Return what a page asks of others.

    Args:
        source: of the page.
        wanted: name of the class; empty: all classes of the page count.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    tree = parse(source)
    found = pages_of(tree)
    pages = [page for page in found.values() if wanted in ("", page.name)]
    if not pages or any(_derives_from_elsewhere(tree, page.name, set(found)) for page in pages):
        return ALL
    commands: set[str] = set()
    readings: set[str] = set()
    for page in found.values():  # a base class of the page counts, too
        _collect(page, commands, readings)
    return Permissions(_fewest(commands), _fewest(readings))


def choosing(source: str) -> dict[str, str] | None:
    """Return the slots for which a page chooses children itself, with kinds; None: it cannot be seen."""
    try:
        tree = parse(source)
    except (SyntaxError, ValueError):
        return {}
    pages = pages_of(tree)
    if any(_derives_from_elsewhere(tree, name, set(pages)) for name in pages):
        return None
    return {slot: kind for page in pages.values() for slot, kind in page.slots.items() if slot in page.chosen}


def _derives_from_elsewhere(tree: ast.Module, name: str, known: set[str]) -> bool:
    """Whether a class has a base that is not in the page, so that its slots cannot be seen."""
    bases = {
        node.name: [last(base) for base in node.bases] for node in tree.body if isinstance(node, ast.ClassDef)
    }
    return any(
        base != ROOT and (base not in known or _derives_from_elsewhere(tree, base, known - {name}))
        for base in bases.get(name, ())
    )


def _collect(page: Page, commands: set[str], readings: set[str]) -> None:
    for slot, command, _ in page.exposed:
        commands.add(f"{page.slots.get(slot, ANY)}.{command}")
    if _hands_itself_on(page):
        for kind in page.slots.values():
            commands.add(f"{kind}.{ANY}")
            readings.add(f"{kind}.{ANY}")
    for method in page.methods:
        named = {node.value: node for node in ast.walk(method) if isinstance(node, ast.Attribute)}
        for node in ast.walk(method):
            if isinstance(node, ast.Attribute) and dotted(node.value) == "self" and node.attr in page.slots:
                kind, above = page.slots[node.attr], named.get(node)
                if above is None or node.attr in page.groups:  # handed on, or a group: anything may follow
                    commands.add(f"{kind}.{ANY}")
                    readings.add(f"{kind}.{ANY}")
                elif above.attr == READINGS:
                    reading = named.get(above)
                    readings.add(f"{kind}.{reading.attr if reading is not None else ANY}")
                elif above.attr not in OF_A_GROUP:
                    commands.add(f"{kind}.{above.attr}")


def _hands_itself_on(page: Page) -> bool:
    """Whether a method uses `self` as a whole, so that what follows cannot be seen."""
    for method in page.methods:
        owners = {node.value for node in ast.walk(method) if isinstance(node, ast.Attribute)}
        names = (node for node in ast.walk(method) if isinstance(node, ast.Name) and node.id == "self")
        if any(name not in owners for name in names):
            return True
    return False


def _fewest(permissions: set[str]) -> tuple[str, ...]:
    """Return the permissions without those that others contain."""
    if EVERYTHING in permissions:
        return (EVERYTHING,)
    wide = {one.partition(".")[0] for one in permissions if one.endswith(f".{ANY}")}
    return tuple(
        sorted(one for one in permissions if one.endswith(f".{ANY}") or one.partition(".")[0] not in wide)
    )
