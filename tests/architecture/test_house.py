"""The house rules that a machine can check."""

from __future__ import annotations

import ast
import asyncio
import logging
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from robotree.tui.line.actions import ACTIONS
from robotree.vr.base.extras import MODULES

ROOT = Path(__file__).parents[2]
ROOMS = ("assistants", "client", "files", "kinds", "protocol", "sim", "vr", "proxy", "testing", "tui")
MAPPED = (*ROOMS, "examples")
NOT_IN_A_ROOM = {"robotree"}  # its one file is front/__init__.py
SOURCES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
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


def imported(path: Path) -> set[str]:
    """Top-level names of the modules that a file imports anywhere."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.partition(".")[0])
    return names


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


def promises_purity(path: Path) -> bool:
    """Whether a module's docstring says that it does no input or output and reads no clock."""
    return PROMISE.search(ast.get_docstring(ast.parse(path.read_text())) or "") is not None


def called(path: Path) -> set[str]:
    """Names of the functions that a file calls by a plain name."""
    return {
        node.func.id
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }


def _forbidden(path: Path) -> set[str]:
    return {"eval"} if relative(path).startswith("vr/bundle/") else {"eval", "exec"}


def test_modules_that_say_pure_import_nothing_that_waits_speaks_or_tells_the_time() -> None:
    pure = [path for path in SOURCES if promises_purity(path)]
    assert len(pure) > 50
    assert not [relative(path) for path in pure if imported(path) & IMPURE]


def test_setuptools_is_told_of_every_subpackage() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    found = {
        "robotree." + relative(path.parent).replace("/", ".")
        for folder in MAPPED
        for path in (ROOT / folder).rglob("__init__.py")
    }
    assert set(project["tool"]["setuptools"]["packages"]) == found | NOT_IN_A_ROOM


def test_each_extra_brings_the_modules_that_its_part_of_the_sources_imports() -> None:
    """And the core brings all that is imported elsewhere."""
    brought_by = packages_distributions()
    core = {
        module for module, packages in brought_by.items() if canonicalize_name(packages[0]) in declared("")
    }
    ours = {*sys.stdlib_module_names, *core, "robotree", "typing_extensions"}  # the last for type checkers
    used: dict[str, set[str]] = {extra: set() for extra in ("", *MODULES)}
    for path in (*SOURCES, *(ROOT / "examples" / "services").glob("*.py")):
        extra = next((e for e, at in WHERE_EXTRAS_ARE_USED.items() if relative(path).startswith(at)), "")
        used[extra] |= imported(path) - ours
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


def test_no_type_of_agents_and_proxies_is_called_like_another() -> None:
    found: dict[str, list[str]] = {}
    for path in SOURCES:
        if relative(path).startswith(("vr/", "proxy/")):
            for name in types_in(ast.parse(path.read_text())):
                found.setdefault(name, []).append(relative(path))
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


def test_a_method_has_a_docstring_unless_what_it_implements_has_one() -> None:
    """Ruff's D102 would have each implementation say `See` and a name."""
    kinds = [
        (relative(path), node)
        for path in SOURCES
        for node in ast.parse(path.read_text()).body
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


def test_functions_fit_on_a_screen() -> None:
    long = [
        f"{relative(path)}: {node.name}"
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno
        and node.end_lineno - node.lineno >= 60
    ]
    assert not long


def test_no_source_imports_a_serialiser_that_runs_code() -> None:
    assert not [relative(path) for path in SOURCES if imported(path) & SERIALISERS]


def test_no_source_is_evaluated_outside_the_bundle_loader() -> None:
    guilty = [relative(path) for path in SOURCES if called(path) & _forbidden(path)]
    assert not guilty


def reads_a_core(source: str) -> bool:
    """Whether a file takes the core of a robot, and does not only make one: `Process.core(state)`."""
    nodes = list(ast.walk(ast.parse(source)))
    made = {id(node.func) for node in nodes if isinstance(node, ast.Call)}
    taken = (node for node in nodes if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load))
    return any(node.attr in {"core", "_core"} and id(node) not in made for node in taken)


def test_the_state_of_a_robot_is_read_under_its_lock() -> None:
    """Others ask `RobotRuntime.look`, which holds the lock, and get values."""
    readers = {relative(path) for path in SOURCES if reads_a_core(path.read_text())}
    assert readers == {"vr/running/robot_runtime.py"}
    assert reads_a_core("machine = agent.runtime.core")
    assert not reads_a_core("made = process.core(state)")


@pytest.mark.parametrize("room", ROOMS)
def test_importing_a_room_is_cheap(room: str) -> None:
    """A room's front door does not pull in simulators, terminals or networks."""
    heavy = "{'mujoco', 'pinocchio', 'textual', 'zenoh', 'pymavlink', 'numpy', 'pint'}"
    code = f"import sys, robotree.{room}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
