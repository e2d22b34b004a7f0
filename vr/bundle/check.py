"""Mistakes of a page that can be seen without running a robot: each with its line, and what to write instead.

Read as Python reads it, never run. What is found here is advice: it may be meant. What is never meant is in
`refused.py`, and a host refuses it. `examine` returns all. Pure.

A command that continues after a crash begins anew and gets the kept results of its steps. Whatever else it
asks must be the same as before: what is not is found, too, with the step to write instead. Nothing of it is
wrong in a page whose commands are short and are simply called again, so these are warnings.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches

from robotree.vr.author.robot import HOOKS, OPTIONS
from robotree.vr.author.virtual_robot import RESERVED
from robotree.vr.base.errors import RequirementUnreadable
from robotree.vr.base.units import Unit
from robotree.vr.bundle.child_calls import Kinds, of_children
from robotree.vr.bundle.reading import Finding, Function, Page, dotted, last, mark, pages_of, used_names
from robotree.vr.bundle.refused import mistakes
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
    found += _of_replay(tree, imported)
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
        name = _called(node, imported)
        if how := _found_in(_CALLS, name):
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
                ) if (what := _TIED.get(_called(made, imported))) and dotted(kept.value) == "self":
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


# -- what a replay would not repeat ----------------------------------------------------------------

_ELSEWHERE = frozenset({"__init__", *HOOKS})
"""Methods that no command runs: they are called anew, and there is nothing to repeat."""

_OTHER = "is another one each time"
_CLOCK = (_OTHER, "write self.now(), which a rehearsal and a replay repeat; take a date as a parameter")
_CHANCE = (_OTHER, "write self.random(), which a rehearsal and a replay repeat")
_NAME = (_OTHER, "write self.context.key, which is unique for each call and the same in a replay")
_CHILD = "have a child's command do it: its result is kept; or take it as a setting or a parameter"
_FILE = ("asks the disk, which may say something else in a replay", _CHILD)
_NETWORK = ("asks the network, which may say something else in a replay", _CHILD)
_PROGRAM = ("runs a program, which a replay would run again", _CHILD)
_PLACE = ("depends on where the host runs", "write a setting of the page")
_THREAD = (
    "runs beside the command in an order that no replay repeats",
    "write `with self.together() as parts: parts.start(…)`, also for functions of the page",
)
_ORDER = ("is gone through in another order in each process", "write sorted(…) around it")

_UNREPEATED: Mapping[str, tuple[str, str]] = {
    **dict.fromkeys(("time.time", "time.monotonic", "time.perf_counter", "time.time_ns"), _CLOCK),
    **dict.fromkeys(("time.monotonic_ns", "time.perf_counter_ns", "time.process_time"), _CLOCK),
    **dict.fromkeys(("time.localtime", "time.gmtime", "time.ctime", "time.strftime"), _CLOCK),
    **dict.fromkeys(("datetime.datetime.now", "datetime.datetime.utcnow"), _CLOCK),
    **dict.fromkeys(("datetime.datetime.today", "datetime.date.today"), _CLOCK),
    **dict.fromkeys(("random.", "secrets.", "numpy.random.", "os.urandom"), _CHANCE),
    **dict.fromkeys(("uuid.uuid1", "uuid.uuid4"), _NAME),
    **dict.fromkeys(("open", "io.open", "os.open", "os.listdir", "os.scandir", "os.walk", "os.stat"), _FILE),
    **dict.fromkeys(("os.remove", "os.rename", "os.replace", "os.mkdir", "os.makedirs", "os.path."), _FILE),
    **dict.fromkeys(("shutil.", "tempfile.", "glob.", "sqlite3.connect", "numpy.load"), _FILE),
    **dict.fromkeys(("socket.", "urllib.request.", "http.client.", "httpx.", "requests."), _NETWORK),
    **dict.fromkeys(("aiohttp.", "ftplib.", "smtplib.", "serial.", "zmq.", "websockets."), _NETWORK),
    **dict.fromkeys(("subprocess.", "os.system", "os.popen"), _PROGRAM),
    **dict.fromkeys(("os.getenv", "os.environ.get", "os.getcwd", "os.getpid", "socket.gethostname"), _PLACE),
    **dict.fromkeys(("threading.Thread", "threading.Timer", "_thread.start_new_thread"), _THREAD),
    **dict.fromkeys(("multiprocessing.", "os.fork", "asyncio.run"), _THREAD),
}
"""Calls, or with a dot at the end modules: what is wrong, and what to write."""

_BUILTINS = frozenset({"open", "input", "breakpoint"})
_OF_PATHS = {"read_text", "read_bytes", "write_text", "write_bytes", "iterdir", "rglob", "unlink", "touch"}
"""Methods that only paths have."""
_SAME = {"os.path.join", "os.path.basename", "os.path.dirname", "os.path.splitext", "os.path.split"}
"""Functions that only compute, though their module asks the system."""


def _of_replay(tree: ast.Module, imported: Mapping[str, str]) -> Iterator[Finding]:
    """Find what a replay would not repeat.

    Args:
        tree: of a page.
        imported: what its names of modules stand for.
    """
    beside = _beside(tree)
    for function in _functions(tree):
        for node in ast.walk(function):
            match node:
                case ast.Call():
                    found = _of_unrepeated(node, imported)
                    yield from (one for one in found if not (_asks_the_disk(one) and _names(node) & beside))
                case (
                    ast.For(iter=ast.Set() | ast.SetComp() as order)
                    | ast.comprehension(iter=ast.Set() | ast.SetComp() as order)
                ):
                    yield _found(order.lineno, "a set", _ORDER)
                case ast.For(iter=ast.Call(func=ast.Name(id="set" | "frozenset")) as order):
                    yield _found(order.lineno, "a set", _ORDER)
                case _:
                    pass


def _beside(tree: ast.Module) -> set[str]:
    """Return the names of paths from the folder of the page: what lies there travels with the page."""
    found = {"__file__"}
    for item in tree.body:
        if isinstance(item, ast.Assign) and _names(item.value) & found:
            found |= {target.id for target in item.targets if isinstance(target, ast.Name)}
    return found


def _names(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _asks_the_disk(found: Finding) -> bool:
    """Whether names are to be gathered for it: for each call of a chain that would take long."""
    return found.what.endswith(_FILE[0])


def _functions(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the functions of a page that a command may run, each once; those inside others come with them."""
    for item in tree.body:
        if isinstance(item, Function):
            yield item
        elif isinstance(item, ast.ClassDef):
            yield from (one for one in item.body if isinstance(one, Function) and one.name not in _ELSEWHERE)


def _of_unrepeated(node: ast.Call, imported: Mapping[str, str]) -> Iterator[Finding]:
    name = _called(node, imported)
    if name not in _SAME and (how := _found_in(_UNREPEATED, name)):
        yield _found(node.lineno, name, how)
    match node.func:
        case ast.Attribute(value=owner, attr=attr) if attr in _OF_PATHS and not _own(owner):
            yield _found(node.lineno, attr, _FILE)
        case _:
            pass


def _called(node: ast.Call, imported: Mapping[str, str]) -> str:
    """Return the full name of what is called; empty: it is nothing that was imported, or built in."""
    first, dot, rest = dotted(node.func).partition(".")
    if first in imported:
        return f"{imported[first]}{dot}{rest}"
    return first if first in _BUILTINS and not dot else ""


def _found_in(table: Mapping[str, tuple[str, str]], name: str) -> tuple[str, str] | None:
    """Return what a table says of a name, or of the module that it is in; None: nothing."""
    modules = (known for known in table if known.endswith(".") and name.startswith(known))
    return table.get(name) or table.get(next(modules, ""))


def _own(owner: ast.expr) -> bool:
    """Whether something belongs to the robot: a child may have a command of any name."""
    return dotted(owner).partition(".")[0] == "self"


def _found(line: int, name: str, how: tuple[str, str]) -> Finding:
    what, instead = how
    return Finding(line, f"{name} {what}", instead, "warning")
