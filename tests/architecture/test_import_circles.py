"""No two modules import each other, directly or through others; imports for types alone count, too.

A circle means that none of its files can be read, tested or replaced without all the others.
"""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
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
    done = subprocess.run(
        [sys.executable, "-c", GRAPH],
        env=os.environ | {"PYTHONPATH": str(ROOT / "typings")},
        capture_output=True,
        text=True,
        check=True,
    )
    return {module: set(names) for module, names in json.loads(done.stdout).items()}


def test_no_import_circle_is_new(imports: dict[str, set[str]]) -> None:
    assert not [sorted(group) for group in circles(imports)]


def test_imports_for_types_alone_are_seen(imports: dict[str, set[str]]) -> None:
    assert "robotree.tui.screen.operator_app" in imports["robotree.tui.screen.part"]


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == {frozenset("abc")}
    assert not circles({"a": {"b", "c"}, "b": {"c"}, "c": set()})
