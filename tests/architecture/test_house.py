"""The house rules that a machine can check."""

from __future__ import annotations

import ast
import asyncio
import itertools
import json
import logging
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from robotree.tui.line.actions import ACTIONS
from robotree.vr.base.extras import MODULES
from tests.command_line import ran

ROOT = Path(__file__).parents[2]
ROOMS = ("assistants", "client", "files", "kinds", "protocol", "sim", "vr", "proxy", "testing", "tui")
MAPPED = (*ROOMS, "examples")
NOT_IN_A_ROOM = {"robotree"}  # its one file is front/__init__.py
SOURCES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
SERVICES = sorted((ROOT / "examples" / "services").glob("*.py"))
SERIALISERS = {"pickle", "cloudpickle", "dill", "marshal", "shelve"}
WHERE_EXTRAS_ARE_USED = {
    "pictures": ("client/",),
    "sim": ("sim/",),
    "tui": (
        *("tui/screen/", "tui/panels/", "tui/seen/cells.py", "tui/seen/halfblocks.py"),
        "tui/seen/graphics.py",
        "tui/recording/replaying.py",
    ),
    "scripts": ("vr/scripts/",),
    "wire": ("protocol/dialect/", "protocol/tools/", "tui/recording/tape.py"),
    "machines": ("vr/sites/", "vr/network/signed.py"),
    "foxglove": ("tui/recording/foxglove_server.py",),
    "lerobot": ("tui/recording/lerobot.py",),
    "mcp": ("assistants/", "tui/demo_mcp.py"),
    "web": ("tui/web/",),
    "languages": ("tui/words/",),
    "postgres": ("vr/space/postgres.py", "vr/journal/postgres.py"),
    "services": ("examples/services/",),
    "testing": ("vr/world/", "testing/"),
}
"""All other sources need the core alone (decision 0058)."""
IMPURE = {"asyncio", "random", "serial", "socket", "sqlite3", "subprocess", "threading", "time", "zenoh"}
PROMISE = re.compile(r"\bPure\b[.:,]")


class Source(NamedTuple):
    """What the rules ask of one file."""

    path: str
    """Below the root of the project."""
    module: ast.Module
    """Without what is in its functions."""
    imported: set[str]
    """Top-level names of the modules that it imports anywhere."""
    called: set[str]
    """Names of the functions that it calls by a plain name."""
    long: list[str]
    """Names of functions of 60 lines or more."""
    reads_a_core: bool
    """Whether it takes the core of a robot, and does not only make one: `Process.core(state)`."""

    @classmethod
    def of(cls, path: str, text: str) -> Source:
        """Read a file once for all rules."""
        module = ast.parse(text)
        imported, called, made = set[str](), set[str](), set[int]()
        functions: list[ast.FunctionDef | ast.AsyncFunctionDef] = []
        cores: list[ast.Attribute] = []
        for node in ast.walk(module):
            match node:
                case ast.Import(names=names):
                    imported |= {alias.name.partition(".")[0] for alias in names}
                case ast.ImportFrom(module=str(name)):
                    imported.add(name.partition(".")[0])
                case ast.Call(func=func):
                    made.add(id(func))
                    if isinstance(func, ast.Name):
                        called.add(func.id)
                case ast.Attribute(attr="core" | "_core", ctx=ast.Load()):
                    cores.append(node)
                case ast.FunctionDef() | ast.AsyncFunctionDef():
                    functions.append(node)
        long = [node.name for node in functions if (node.end_lineno or 0) - node.lineno >= 60]
        reads_a_core = any(id(node) not in made for node in cores)
        for function in functions:
            del function.body[1:]  # a docstring stays; all others would fill the memory
        return cls(path, module, imported, called, long, reads_a_core)


@pytest.fixture(scope="module")
def sources() -> list[Source]:
    """All files of the rooms."""
    return [Source.of(relative(path), path.read_text()) for path in SOURCES]


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


def _forbidden(source: Source) -> set[str]:
    return {"eval"} if source.path.startswith("vr/bundle/") else {"eval", "exec"}


def test_modules_that_say_pure_import_nothing_that_waits_speaks_or_tells_the_time(
    sources: list[Source],
) -> None:
    pure = [source for source in sources if PROMISE.search(ast.get_docstring(source.module) or "")]
    assert len(pure) > 50
    assert not [source.path for source in pure if source.imported & IMPURE]


def test_setuptools_is_told_of_every_subpackage() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    found = {
        "robotree." + relative(path.parent).replace("/", ".")
        for folder in MAPPED
        for path in (ROOT / folder).rglob("__init__.py")
    }
    assert set(project["tool"]["setuptools"]["packages"]) == found | NOT_IN_A_ROOM


def test_each_extra_brings_the_modules_that_its_part_of_the_sources_imports(sources: list[Source]) -> None:
    """And the core brings all that is imported elsewhere."""
    brought_by = packages_distributions()
    core = {
        module for module, packages in brought_by.items() if canonicalize_name(packages[0]) in declared("")
    }
    ours = {*sys.stdlib_module_names, *core, "robotree", "typing_extensions"}  # the last for type checkers
    used: dict[str, set[str]] = {extra: set() for extra in ("", *MODULES)}
    services = [Source.of(relative(path), path.read_text()) for path in SERVICES]
    for source in (*sources, *services):
        extra = next((e for e, at in WHERE_EXTRAS_ARE_USED.items() if source.path.startswith(at)), "")
        used[extra] |= source.imported - ours
    assert not used.pop("")
    assert used == {extra: set(modules) for extra, modules in MODULES.items()}
    for extra, modules in MODULES.items():
        packages = {
            canonicalize_name(brought_by.get(one, ["pin"])[0]) for one in modules
        }  # cmeel hides pin's
        assert packages <= whole(declared(extra))


def whole(packages: set[str]) -> set[str]:
    """Return packages, and all that those need."""
    found, left = set[str](), [*packages]
    while left:
        if (name := left.pop()) not in found:
            found.add(name)
            needs = [Requirement(one) for one in requires(name) or []]
            left += [
                canonicalize_name(need.name) for need in needs if not need.marker or need.marker.evaluate()
            ]
    return found


def declared(extra: str) -> set[str]:
    """Names of the packages that pyproject.toml names for an extra; "": for the core."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    given = project["optional-dependencies"][extra] if extra else project["dependencies"]
    return {canonicalize_name(Requirement(one).name) for one in given}


def test_a_verb_needs_extras_that_there_are() -> None:
    assert {extra for action in ACTIONS for extra in action.needs} <= set(MODULES)


def test_no_type_of_agents_and_proxies_is_called_like_another(sources: list[Source]) -> None:
    found: dict[str, list[str]] = {}
    for source in sources:
        if source.path.startswith(("vr/", "proxy/")):
            for name in types_in(source.module):
                found.setdefault(name, []).append(source.path)
    assert found
    assert not {name: places for name, places in found.items() if len(places) > 1}


def types_in(module: ast.Module) -> Iterator[str]:
    """Give the public classes of a module, and its names for other types: `Sender = Callable[…]`."""
    for node in module.body:
        match node:
            case ast.ClassDef(name=name):
                pass
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Subscript() | ast.BinOp()):
                pass
            case _:
                continue
        if name[0].isupper() and not name.isupper():
            yield name


def base_names(kind: ast.ClassDef) -> set[str]:
    """Names of the bases of a class: `Protocol[T]` and `typing.Protocol` are `Protocol`."""
    plain = (base.value if isinstance(base, ast.Subscript) else base for base in kind.bases)
    return {getattr(base, "attr", getattr(base, "id", "")) for base in plain}


def public_methods(kind: ast.ClassDef) -> dict[str, bool]:
    """Names of the methods of a class, and whether each has a docstring."""
    methods = (node for node in kind.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    found: dict[str, bool] = {}
    for node in methods:
        if not node.name.startswith("_"):  # of a property, the getter has the docstring
            found[node.name] = found.get(node.name, False) or bool(ast.get_docstring(node))
    return found


def test_a_method_has_a_docstring_unless_what_it_implements_has_one(sources: list[Source]) -> None:
    """Ruff's D102 would have each implementation say `See` and a name."""
    kinds = [
        (source.path, node)
        for source in sources
        for node in source.module.body
        if isinstance(node, ast.ClassDef)
    ]
    implemented = {name for _, kind in kinds for name in base_names(kind)}
    described = (
        set(dir(asyncio.AbstractEventLoop)) | set(dir(asyncio.TimerHandle)) | set(dir(logging.Handler))
    )
    for _, kind in kinds:
        if kind.name in implemented or "Protocol" in base_names(kind):
            described |= {name for name, has_docstring in public_methods(kind).items() if has_docstring}
    assert not [
        f"{path}: {kind.name}.{name}"
        for path, kind in kinds
        if not kind.name.startswith("_")
        for name, has_docstring in public_methods(kind).items()
        if not has_docstring and name not in described
    ]


def test_functions_fit_on_a_screen(sources: list[Source]) -> None:
    assert not {source.path: source.long for source in sources if source.long}


def test_no_source_imports_a_serialiser_that_runs_code(sources: list[Source]) -> None:
    assert not [source.path for source in sources if source.imported & SERIALISERS]


def test_no_source_is_evaluated_outside_the_bundle_loader(sources: list[Source]) -> None:
    assert not [source.path for source in sources if source.called & _forbidden(source)]


def test_the_state_of_a_robot_is_read_under_its_lock(sources: list[Source]) -> None:
    """Others ask `RobotRuntime.look`, which holds the lock, and get values."""
    assert [source.path for source in sources if source.reads_a_core] == ["vr/running/robot_runtime.py"]
    assert Source.of("", "machine = agent.runtime.core").reads_a_core
    assert not Source.of("", "made = process.core(state)").reads_a_core


@pytest.mark.parametrize("room", ROOMS)
def test_importing_a_room_is_cheap(room: str) -> None:
    """A room's front door does not pull in simulators, terminals or networks."""
    heavy = "{'mujoco', 'pinocchio', 'textual', 'zenoh', 'pymavlink', 'numpy', 'pint'}"
    code = f"import sys, robotree.{room}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# -- a circle of imports means that none of its files can be read, tested or replaced without all the others

GRAPH = """
import grimp, json
graph = grimp.build_graph("robotree", exclude_type_checking_imports=False)
print(json.dumps({name: sorted(graph.find_modules_directly_imported_by(name)) for name in graph.modules}))
"""
"""For a process in which `robotree` is one folder, as grimp wants it: typings/robotree links the rooms."""


def circles(imports: dict[str, set[str]]) -> set[frozenset[str]]:
    """Return the groups of modules that reach each other (strongly connected components; Tarjan, 1972)."""
    count = itertools.count()
    index: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: set[frozenset[str]] = set()

    def visit(module: str) -> None:
        index[module] = lowest[module] = next(count)
        stack.append(module)
        for other in sorted(imports.get(module, ())):
            if other not in index:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in stack:
                lowest[module] = min(lowest[module], index[other])
        if lowest[module] == index[module]:
            group = set(stack[stack.index(module) :])
            del stack[stack.index(module) :]
            if len(group) > 1:
                found.add(frozenset(group))

    for module in sorted(imports):
        if module not in index:
            visit(module)
    return found


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    """By module of ours: the modules of ours that it imports anywhere."""
    done = ran(
        [sys.executable, "-c", GRAPH], check=True, env=os.environ | {"PYTHONPATH": str(ROOT / "typings")}
    )
    return {module: set(names) for module, names in json.loads(done.stdout).items()}


def test_no_import_circle_is_new(imports: dict[str, set[str]]) -> None:
    assert not [sorted(group) for group in circles(imports)]


def test_imports_for_types_alone_are_seen(imports: dict[str, set[str]]) -> None:
    assert "robotree.tui.screen.operator_app" in imports["robotree.tui.screen.part"]


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == {frozenset("abc")}
    assert not circles({"a": {"b", "c"}, "b": {"c"}, "c": set()})
