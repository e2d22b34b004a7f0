"""Lines that give another result when a command is carried out again with what it has done so far. Pure.

A command that continues after a crash begins anew and gets the kept results of its steps. Whatever else it
asks must be the same as before: what is not is found here, with the step to write instead. Nothing of it is
wrong in a page whose commands are short and are simply called again, so these are warnings.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping

from robotree.vr.author.robot import HOOKS
from robotree.vr.bundle.reading import Finding, Function, dotted

ELSEWHERE = frozenset({"__init__", *HOOKS})
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

CALLS: Mapping[str, tuple[str, str]] = {
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

BUILTINS = frozenset({"open", "input", "breakpoint"})
OF_PATHS = {"read_text", "read_bytes", "write_text", "write_bytes", "iterdir", "rglob", "unlink", "touch"}
"""Methods that only paths have."""
SAME = {"os.path.join", "os.path.basename", "os.path.dirname", "os.path.splitext", "os.path.split"}
"""Functions that only compute, though their module asks the system."""


def of_replay(tree: ast.Module, imported: Mapping[str, str]) -> Iterator[Finding]:
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
                    found = _of_call(node, imported)
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
            yield from (one for one in item.body if isinstance(one, Function) and one.name not in ELSEWHERE)


def _of_call(node: ast.Call, imported: Mapping[str, str]) -> Iterator[Finding]:
    name = called(node, imported)
    if name not in SAME and (how := found_in(CALLS, name)):
        yield _found(node.lineno, name, how)
    match node.func:
        case ast.Attribute(value=owner, attr=attr) if attr in OF_PATHS and not _own(owner):
            yield _found(node.lineno, attr, _FILE)
        case _:
            pass


def called(node: ast.Call, imported: Mapping[str, str]) -> str:
    """Return the full name of what is called; empty: it is nothing that was imported, or built in."""
    first, dot, rest = dotted(node.func).partition(".")
    if first in imported:
        return f"{imported[first]}{dot}{rest}"
    return first if first in BUILTINS and not dot else ""


def found_in(table: Mapping[str, tuple[str, str]], name: str) -> tuple[str, str] | None:
    """Return what a table says of a name, or of the module that it is in; None: nothing."""
    modules = (known for known in table if known.endswith(".") and name.startswith(known))
    return table.get(name) or table.get(next(modules, ""))


def _own(owner: ast.expr) -> bool:
    """Whether something belongs to the robot: a child may have a command of any name."""
    return dotted(owner).partition(".")[0] == "self"


def _found(line: int, name: str, how: tuple[str, str]) -> Finding:
    what, instead = how
    return Finding(line, f"{name} {what}", instead, "warning")
