"""The house rules that a machine can check."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("protocol", "sim", "vr", "proxy", "tui")
MAPPED = (*ROOMS, "examples")
SOURCES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
SERIALISERS = {"pickle", "cloudpickle", "dill", "marshal", "shelve"}
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


@pytest.mark.parametrize("path", list(filter(promises_purity, SOURCES)), ids=relative)
def test_who_says_pure_imports_nothing_that_waits_speaks_or_tells_the_time(path: Path) -> None:
    assert not imported(path) & IMPURE


def test_setuptools_is_told_of_every_subpackage() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    found = {
        "robotree." + relative(path.parent).replace("/", ".")
        for folder in MAPPED
        for path in (ROOT / folder).rglob("__init__.py")
    }
    assert set(project["tool"]["setuptools"]["packages"]) == found


@pytest.mark.parametrize("path", [*SOURCES, *TESTS], ids=relative)
def test_no_file_has_a_second_idea(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 400


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_no_function_is_longer_than_a_screen(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno:
            assert node.end_lineno - node.lineno < 60, node.name


def test_the_median_file_is_short() -> None:
    lengths = sorted(len(path.read_text().splitlines()) for path in SOURCES)
    assert lengths[len(lengths) // 2] <= 150


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_nothing_travels_as_pickled_objects(path: Path) -> None:
    assert not imported(path) & SERIALISERS


@pytest.mark.parametrize("path", SOURCES, ids=relative)
def test_no_source_is_evaluated_outside_the_bundle_loader(path: Path) -> None:
    calls = {
        node.func.id
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    forbidden = {"eval"} if relative(path).startswith("vr/bundle/") else {"eval", "exec"}
    assert not calls & forbidden


@pytest.mark.parametrize("room", ROOMS)
def test_importing_a_room_is_cheap(room: str) -> None:
    """A room's front door does not pull in simulators, terminals or networks."""
    heavy = "{'mujoco', 'pinocchio', 'textual', 'zenoh', 'pymavlink', 'numpy', 'pint'}"
    code = f"import sys, robotree.{room}; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
