"""Each test checks something itself."""

from __future__ import annotations

import ast
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
