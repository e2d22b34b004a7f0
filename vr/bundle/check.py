"""Mistakes of a page that can be seen without running a robot: each with its line, and what to write instead.

Read as Python reads it, never run. What `examine` finds is advice: it may be meant. What `replaced_slots`
finds is never meant, and a host refuses it. Pure.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches

import msgspec

from robotree.vr.base.units import Unit
from robotree.vr.bundle.syntax import parse

ROOT = "VirtualRobot"
OF_EVERY_KIND = frozenset({"set"})
"""Commands that a robot of any kind may have."""

HOOKS = ("readings", "safe_stop", "resume", "begins", "one_at_a_time", "reading_units", "isolated")
"""What a page may define for its host to use."""

_WAIT = ("holds the robot up", "write self.sleep(seconds): a cancel and a stop end it at once")
_ASIDE = "call it in a thread (concurrent.futures), and wait with self.sleep until it is done"
_BLOCK = ("may block", f"no cancel and no stop ends it: {_ASIDE}")
_CLOCK = ("is another one each time", "write self.now(), which a rehearsal and a replay repeat")
_CHANCE = ("is another one each time", "write self.random(), which a rehearsal and a replay repeat")
_CALLS = {
    "time.sleep": _WAIT,
    **dict.fromkeys(("input", "os.system", "os.wait", "select.select", "requests.", "subprocess."), _BLOCK),
    **dict.fromkeys(("socket.", "urllib.request.", "http.client.", "httpx."), _BLOCK),
    **dict.fromkeys(("time.time", "time.monotonic", "time.perf_counter", "time.time_ns"), _CLOCK),
    **dict.fromkeys(("datetime.datetime.now", "datetime.datetime.utcnow", "datetime.date.today"), _CLOCK),
    **dict.fromkeys(("uuid.uuid4", "uuid.uuid1", "os.urandom"), _CHANCE),
    **dict.fromkeys(("random.", "secrets.", "numpy.random."), _CHANCE),
}
"""Calls, or with a dot at the end modules, that a page should not use: what is wrong, and what to write."""
_CHANGES = {
    *("append", "extend", "insert", "add", "update", "pop", "popitem"),
    *("remove", "discard", "clear", "setdefault"),
}
"""Methods that change a list, a dict or a set in place."""


class Finding(msgspec.Struct, frozen=True):
    """One thing that is probably a mistake."""

    line: int
    what: str
    instead: str
    """What to write instead, or to do."""


def examine(source: str, kinds: Mapping[str, Collection[str]]) -> list[Finding]:
    """Return what is probably wrong with a page, by line.

    Args:
        source: Python.
        kinds: the commands of the kinds of robots that are known, by name of the kind.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    tree = parse(source)
    pages = _pages(tree)
    found = [*_of_calls(tree, _imports(tree)), *_of_units(tree)]
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    known = {**kinds, **{name: page.commands for name, page in pages.items()}}
    for page in pages.values():
        found += [*_of_slots(page), *_of_state(page), *_of_bare(page), *_of_hooks(page, used)]
        found += _of_children(page, known)
    return sorted(set(found), key=lambda one: (one.line, one.what))


def replaced_slots(source: str) -> list[Finding]:
    """Return the lines in which a page assigns to one of its slots: the child would be gone without a word.

    Raises:
        SyntaxError, ValueError: see `examine`.
    """
    return [found for page in _pages(parse(source)).values() for found in _of_slots(page)]


class _Page:
    """One robot's class in a file."""

    def __init__(self, node: ast.ClassDef, base: _Page | None) -> None:
        self.methods = [one for one in node.body if isinstance(one, ast.FunctionDef)]
        self.slots: dict[str, str] = dict(base.slots) if base else {}
        self.declared: set[str] = set(base.declared) if base else set()
        """Settings and state."""
        self.bare: dict[str, ast.AnnAssign] = {}
        """Attributes with a type and no value."""
        self.exposed: list[tuple[str, str, int]] = []
        """Slot, command and line."""
        self.commands: set[str] = set(base.commands) if base else set()
        self.commands |= {one.name for one in self.methods if _mark(one) is not None}
        self.plain = {one.name: one.lineno for one in self.methods if not one.decorator_list}
        """Lines of its other methods and attributes."""
        for item in node.body:
            if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                if item.value:
                    self.declared.add(item.target.id)
                else:
                    self.bare[item.target.id] = item
            elif isinstance(item, ast.Assign) and isinstance(item.targets[0], ast.Name):
                self._take(item.targets[0].id, item.value)

    def of_self(self) -> Iterator[ast.Attribute]:
        """Yield each `self.something` in its methods."""
        for method in self.methods:
            for node in ast.walk(method):
                if isinstance(node, ast.Attribute) and _dotted(node.value) == "self":
                    yield node

    def _take(self, name: str, value: ast.expr) -> None:
        match value:
            case ast.Call(func=ast.Name(id="Child" | "Children"), args=[kind, *_]):
                self.slots[name] = _kind(kind)
            case ast.Call(func=ast.Attribute(value=ast.Name(id=slot), attr="exposed"), args=given):
                command = given[0].value if given and isinstance(given[0], ast.Constant) else name
                self.exposed.append((slot, str(command), value.lineno))
                self.commands.add(name)
            case _:
                self.commands.discard(name)
                self.slots.pop(name, None)
                self.plain[name] = value.lineno


def _pages(tree: ast.Module) -> dict[str, _Page]:
    found: dict[str, _Page] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            bases = [_last(base) for base in node.bases]
            inherited = next((found[base] for base in bases if base in found), None)
            if inherited is not None or ROOT in bases:
                found[node.name] = _Page(node, inherited)
    return found


def _kind(node: ast.expr) -> str:
    return str(node.value) if isinstance(node, ast.Constant) else _last(node)


def _dotted(node: ast.AST) -> str:
    """Return `a.b.c` as it is written; empty: it is something else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (left := _dotted(node.value)):
        return f"{left}.{node.attr}"
    return ""


def _last(node: ast.AST) -> str:
    """Return `c` of `a.b.c`."""
    return _dotted(node).rpartition(".")[2]


def _mark(method: ast.FunctionDef) -> str | None:
    """Return the effect of a command; None: the method is none."""
    for one in method.decorator_list:
        call = one if isinstance(one, ast.Call) else ast.Call(one, [], [])
        if _last(call.func) == "command":
            effects = (each.value for each in call.keywords if each.arg == "effect")
            return next((str(one.value) for one in effects if isinstance(one, ast.Constant)), "once")
    return None


# -- calls -----------------------------------------------------------------------------------------


def _imports(tree: ast.Module) -> dict[str, str]:
    """Return what the names that a file imports stand for: `{"sleep": "time.sleep"}`."""
    found: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for one in node.names:
                first = one.name.partition(".")[0]
                found |= {one.asname: one.name} if one.asname else {first: first}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {one.asname or one.name: f"{node.module}.{one.name}" for one in node.names}
    return found


def _of_calls(tree: ast.Module, imported: Mapping[str, str]) -> Iterator[Finding]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        first, dot, rest = _dotted(node.func).partition(".")
        if first != "input" and first not in imported:
            continue
        name = f"{imported.get(first, first)}{dot}{rest}"
        for known, (what, instead) in _CALLS.items():
            if name == known or (known.endswith(".") and name.startswith(known)):
                yield Finding(node.lineno, f"{name} {what}", instead)


def _of_units(tree: ast.Module) -> Iterator[Finding]:
    for node in ast.walk(tree):
        match node:
            case ast.Call(args=[ast.Constant(value=str(symbol)), *_]) if _last(node.func) == "Unit":
                try:
                    Unit(symbol)
                except ValueError as error:
                    known = "write a unit that is known, such as m, rad, N, m/s"
                    yield Finding(node.lineno, str(error), known)
            case _:
                pass


# -- what a page keeps and defines -----------------------------------------------------------------


def _of_slots(page: _Page) -> Iterator[Finding]:
    """Find slots and exposed commands that a method replaces by something else."""
    for node in page.of_self():
        if node.attr in page.slots and not isinstance(node.ctx, ast.Load):
            what = f"self.{node.attr} is a slot, and this takes the child away"
            yield Finding(node.lineno, what, f"keep the value under another name, such as self._{node.attr}")


def _of_hooks(page: _Page, used: set[str]) -> Iterator[Finding]:
    """Find what has nearly the name of a hook, and is used nowhere in the file."""
    for name, line in page.plain.items():
        near = get_close_matches(name, HOOKS, n=1, cutoff=0.75)
        if near and name not in HOOKS and name not in used:
            yield Finding(line, f"nothing calls {name}", f"did you mean {near[0]}?")


def _of_state(page: _Page) -> Iterator[Finding]:
    """Find what a page keeps and would lose, and what a reading command changes."""
    for method in page.methods:
        if method.name == "__init__":
            continue
        reads = _mark(method) == "read"
        for name, line in _changed(method):
            if name in page.declared:
                if reads:
                    yield Finding(
                        line,
                        f'{method.name} says effect="read" and changes self.{name}',
                        "take the effect away, or leave self as it is",
                    )
            elif not name.startswith("_") and name not in page.slots:
                yield Finding(
                    line,
                    f"self.{name} does not survive a reload or a restart",
                    f"declare it in the class, `{name}: int = state(0)` with its type, or name it _{name}",
                )


def _of_bare(page: _Page) -> Iterator[Finding]:
    """Find attributes that look like settings and have no value."""
    given = page.declared.union(*({name for name, _ in _changed(method)} for method in page.methods))
    for name, item in page.bare.items():
        if name not in given and not name.startswith("_"):
            yield Finding(
                item.lineno,
                f"{name} has a type and no value, so that it is no setting",
                f"write its default, too: {name}: {ast.unparse(item.annotation)} = …",
            )


def _changed(method: ast.FunctionDef) -> Iterator[tuple[str, int]]:
    """Return the attributes of self that a method changes, with the lines."""
    for node in ast.walk(method):
        targets: list[ast.expr] = []
        match node:
            case ast.Assign(targets=targets):
                pass
            case ast.AugAssign(target=changing) | ast.AnnAssign(target=changing):
                targets = [changing]
            case ast.Call(func=ast.Attribute(value=ast.Attribute() as changed, attr=way)) if way in _CHANGES:
                targets = [changed]
            case _:
                pass
        for changes in targets:
            for one in changes.elts if isinstance(changes, ast.Tuple | ast.List) else [changes]:
                inner = one.value if isinstance(one, ast.Subscript) else one
                if isinstance(inner, ast.Attribute) and _dotted(inner.value) == "self":
                    yield inner.attr, inner.lineno


# -- children --------------------------------------------------------------------------------------


def _of_children(page: _Page, kinds: Mapping[str, Collection[str]]) -> Iterator[Finding]:
    """Find commands that the kind of a slot lacks."""
    used = [*page.exposed]
    for node in (node for method in page.methods for node in ast.walk(method)):
        match node:
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id="self"), attr=slot), attr=command):
                if not command.startswith("_"):
                    used.append((slot, command, node.lineno))
            case _:
                pass
    for slot, command, line in used:
        known = kinds.get(page.slots.get(slot, ""))
        if known is not None and command not in known and command not in OF_EVERY_KIND:
            kind = page.slots[slot]
            names = ", ".join(sorted(known)) or "none"
            what = f"{slot} is of kind {kind}, which has no command {command!r}"
            yield Finding(line, what, f"it has: {names}")
