"""Each test checks something itself, and those that measure the machine do it alone."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
CHECKING = {
    "raises": "pytest's own",
    "until": "waits for a condition and fails without it",
    "sees": "waits for words on the screen and fails without them",
    "reads": "waits for a line of MAVProxy and fails without it",
    "rehearse_seeds": "the laws of the World under many seeds",
}
"""Helpers that fail by themselves, and why. `assert_...`, `check...` and those of the same file count too."""

MEASURES = re.compile(r"\b(thread|process)_time\(\)")
"""Processor time grows, too, when another process works on the same core. `make test` runs tests with this
marker one at a time; see CONTRIBUTING.md."""
SPEED = "pytest.mark.speed"

Function = ast.FunctionDef | ast.AsyncFunctionDef


def checks(function: Function, helpers: set[str]) -> bool:
    """Whether a function holds an assertion or calls something that does."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assert):
            return True
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in helpers or name.startswith(("assert_", "check")):
                return True
    return False


def mute(source: str) -> list[str]:
    """The tests of a file that check nothing."""
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, Function)]
    plain = [each for each in functions if not each.name.startswith("test_")]
    helpers = set(CHECKING) | {each.name for each in plain if checks(each, set(CHECKING))}
    return [each.name for each in functions if each not in plain and not checks(each, helpers)]


def test_each_test_checks_something_itself() -> None:
    found = {
        str(path.relative_to(ROOT)): mute(path.read_text()) for path in (ROOT / "tests").rglob("test_*.py")
    }
    assert len(found) > 200
    assert not {path: names for path, names in found.items() if names}


def test_a_test_that_only_runs_something_is_found() -> None:
    assert mute("def test_it(): run()") == ["test_it"]
    assert not mute("def look(): assert 1\ndef test_it(): look()")


def disturbed(source: str) -> list[str]:
    """The tests of a file that measure processor time beside other tests."""
    tree = ast.parse(source)
    marks = [
        ast.unparse(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    return [
        node.name
        for node in ast.walk(tree)
        if isinstance(node, Function)
        and node.name.startswith("test_")
        and MEASURES.search(ast.unparse(node))
        and not any(SPEED in text for text in [*marks, *map(ast.unparse, node.decorator_list)])
    ]


def test_a_test_that_measures_processor_time_runs_alone() -> None:
    sources = {path: path.read_text() for path in (ROOT / "tests").rglob("test_*.py")}
    found = {str(path.relative_to(ROOT)): disturbed(source) for path, source in sources.items()}
    assert sum(SPEED in source for source in sources.values()) > 5
    assert not {path: names for path, names in found.items() if names}


def test_a_test_that_measures_processor_time_beside_others_is_found() -> None:
    clock = "process_time"
    measuring = f"def test_it():\n began = time.{clock}()\n assert time.{clock}() - began < 1"
    assert disturbed(measuring) == ["test_it"]
    assert not disturbed(f"@{SPEED}\n{measuring}")


def test_make_test_runs_what_measures_speed_alone_after_all_others() -> None:
    options = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
    assert "not speed" in options["addopts"][-1]
    _, _, recipe = (ROOT / "Makefile").read_text().partition("\ntest: ")
    first, second = re.findall(r"-m pytest (.*)", recipe.partition("\n\n")[0])
    assert first == "-n $(WORKERS)"
    assert second == r"""-m "speed and not soak" $$(grep -rl --include='test_*.py' 'mark\.speed' tests)"""
    marked = {path.name for path in (ROOT / "tests").rglob("*.py") if SPEED in path.read_text()}
    assert all(name.startswith("test_") for name in marked), "only these are searched for tests of speed"
