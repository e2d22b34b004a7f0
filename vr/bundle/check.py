"""Mistakes of a page that can be seen without running a robot: each with its line, and what to write instead.

Read as Python reads it, never run. What is found here is advice: it may be meant. What is never meant is in
`refused.py`, and a host refuses it; what a replay would not repeat is in `replayed.py`: warnings. `examine`
returns all. Pure.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches

from robotree.vr.author.robot import OPTIONS
from robotree.vr.author.virtual_robot import RESERVED
from robotree.vr.base.errors import RequirementUnreadable
from robotree.vr.base.units import Unit
from robotree.vr.bundle.child_calls import Kinds, of_children
from robotree.vr.bundle.reading import Finding, Function, Page, dotted, last, mark, pages_of, used_names
from robotree.vr.bundle.refused import mistakes
from robotree.vr.bundle.replayed import called, found_in, of_replay
from robotree.vr.bundle.syntax import parse
from robotree.vr.scripts.requirement import requirement

_WAIT = ("holds the robot up", "write self.sleep(seconds): a cancel and a stop end it at once")
_ASIDE = "call it in a thread (concurrent.futures), and wait with self.sleep until it is done"
_BLOCK = ("may block", f"no cancel and no stop ends it: {_ASIDE}")
_DEBUG = ("waits for a keyboard", "a host has none: take it away, and use print, or it in a rehearsal")
_CALLS = {
    "time.sleep": _WAIT,
    **dict.fromkeys(("breakpoint", "pdb.set_trace", "code.interact"), _DEBUG),
    **dict.fromkeys(("input", "os.system", "os.wait", "select.select", "requests.", "subprocess."), _BLOCK),
    **dict.fromkeys(("socket.", "urllib.request.", "http.client.", "httpx."), _BLOCK),
}
"""Calls, or with a dot at the end modules, that a page should not use: what is wrong, and what to write."""
_TIED = {
    **dict.fromkeys(("open", "io.open", "os.open", "os.fdopen"), "an open file"),
    **dict.fromkeys(("socket.socket", "socket.create_connection"), "a socket"),
    **dict.fromkeys(("threading.Thread", "threading.Timer"), "a thread"),
    **dict.fromkeys(
        ("threading.Lock", "threading.RLock", "threading.Event", "threading.Condition"), "a lock"
    ),
}
"""Calls that make what exists in one process only, and what that is; see `agents/unfit.py`."""
_CHANGES = {
    *("append", "extend", "insert", "add", "update", "pop", "popitem"),
    *("remove", "discard", "clear", "setdefault"),
}
"""Methods that change a list, a dict or a set in place."""


def examine(source: str, kinds: Kinds) -> list[Finding]:
    """Return what is probably wrong with a page, by line.

    Args:
        source: Python.
        kinds: the commands of the kinds of robots that are known, by name of the kind; None: a command of
            which only the name is known.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    tree = parse(source)
    pages = pages_of(tree)
    imported = _imports(tree)
    found = [*mistakes(source), *_of_calls(tree, imported), *_of_units(tree), *_of_defaults(tree)]
    found += _of_requirements(tree)
    found += of_replay(tree, imported)
    used = used_names(tree)
    known = {**kinds, **{name: dict.fromkeys(page.commands) for name, page in pages.items()}}
    for page in pages.values():
        found += [*_of_state(page), *_of_bare(page), *_of_options(page, used), *_of_async(page)]
        found += [*of_children(page, known), *_of_tied(page, imported)]
    return sorted(set(found), key=lambda one: (one.line, one.what))


# -- calls -----------------------------------------------------------------------------------------


def _imports(tree: ast.Module) -> dict[str, str]:
    """Return what the names that a file imports stand for: `{"sleep": "time.sleep"}`."""
    found: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                first = name.name.partition(".")[0]
                found |= {name.asname: name.name} if name.asname else {first: first}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {name.asname or name.name: f"{node.module}.{name.name}" for name in node.names}
    return found


def _of_calls(tree: ast.Module, imported: Mapping[str, str]) -> Iterator[Finding]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = called(node, imported)
        if how := found_in(_CALLS, name):
            yield Finding(node.lineno, f"{name} {how[0]}", how[1])


def _of_requirements(tree: ast.Module) -> Iterator[Finding]:
    """Find slots whose `where` cannot be read."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or last(node.func) not in {"Child", "Children"}:
            continue
        for given in node.keywords:
            if given.arg == "where" and isinstance(given.value, ast.Constant):
                try:
                    requirement(str(given.value.value))
                except RequirementUnreadable as error:
                    yield Finding(given.value.lineno, str(error), "see `robotree help enslave`")


def _of_units(tree: ast.Module) -> Iterator[Finding]:
    for node in ast.walk(tree):
        match node:
            case ast.Call(args=[ast.Constant(value=str(symbol)), *_]) if last(node.func) == "Unit":
                try:
                    Unit(symbol)
                except ValueError as error:
                    known = "write a unit that is known, such as m, rad, N, m/s"
                    yield Finding(node.lineno, str(error), known)
            case _:
                pass


# -- what a page keeps and defines -----------------------------------------------------------------


def _of_defaults(tree: ast.Module) -> Iterator[Finding]:
    """Find defaults of functions that all calls share; a command gets a copy of its own."""
    for node in ast.walk(tree):
        if not isinstance(node, Function) or mark(node) is not None:
            continue
        for default in filter(None, (*node.args.defaults, *node.args.kw_defaults)):
            made = isinstance(default, ast.Call) and dotted(default.func) in {"list", "dict", "set"}
            if made or isinstance(default, ast.List | ast.Dict | ast.Set):
                yield Finding(
                    default.lineno,
                    f"all calls of {node.name} share the default {ast.unparse(default)}",
                    "write None, and make it inside of the function",
                )


def _of_async(page: Page) -> Iterator[Finding]:
    """Find all commands that are written as coroutines."""
    for method in page.methods:
        if isinstance(method, ast.AsyncFunctionDef) and mark(method) is not None:
            yield Finding(
                method.lineno,
                f"{page.name}.{method.name}: write it without async",
                "a command has a thread of its own and may block",
            )


def _of_options(page: Page, used: Collection[str]) -> Iterator[Finding]:
    """Find attributes that have nearly the name of one that the agent reads."""
    methods = {method.name for method in page.methods}
    for name, line in page.plain.items():
        near = get_close_matches(name, OPTIONS, n=1, cutoff=0.75)
        if near and name not in methods and name not in OPTIONS and name not in used:
            yield Finding(line, f"nothing reads {name}", f"did you mean {near[0]}?")


def _of_state(page: Page) -> Iterator[Finding]:
    """Find what a page keeps and would lose, and what a reading command changes."""
    for method in page.methods:
        if method.name == "__init__":
            continue
        reads = mark(method) == "read"
        for name, line in _changed(method):
            if name in page.declared:
                if reads:
                    yield Finding(
                        line,
                        f'{method.name} says effect="read" and changes self.{name}',
                        "take the effect away, or leave self as it is",
                    )
            elif not name.startswith("_") and name not in {*page.slots, *RESERVED}:
                yield Finding(
                    line,
                    f"self.{name} does not survive a reload",
                    f"declare it in the class, `{name}: int = state(0)` with its type, or name it _{name}",
                )


def _of_tied(page: Page, imported: Mapping[str, str]) -> Iterator[Finding]:
    """Find attributes that keep a robot in its process: it could not move to another host."""
    for method in page.methods:
        for node in ast.walk(method):
            match node:
                case (
                    ast.Assign(targets=[ast.Attribute() as kept], value=ast.Call() as made)
                    | ast.AnnAssign(target=ast.Attribute() as kept, value=ast.Call() as made)
                ) if (what := _TIED.get(called(made, imported))) and dotted(kept.value) == "self":
                    why = f"self.{kept.attr} is {what}: the robot cannot move to another host"
                    yield Finding(kept.lineno, why, "make it where it is used, and let go of it there")
                case _:
                    pass


def _of_bare(page: Page) -> Iterator[Finding]:
    """Find attributes that look like settings and have no value."""
    given = page.declared.union(*({name for name, _ in _changed(method)} for method in page.methods))
    for name, item in page.bare.items():
        if name not in given and not name.startswith("_"):
            yield Finding(
                item.lineno,
                f"{name} has a type and no value, so that it is no setting",
                f"write its default, too: {name}: {ast.unparse(item.annotation)} = …",
            )


def _changed(method: Function) -> Iterator[tuple[str, int]]:
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
                if isinstance(inner, ast.Attribute) and dotted(inner.value) == "self":
                    yield inner.attr, inner.lineno
