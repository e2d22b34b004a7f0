"""The names that `robotree.vr` offers are loaded when they are used, and are those that type checkers see."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import robotree.vr


def test_each_name_is_the_one_that_type_checkers_are_told_of() -> None:
    tree = ast.parse(Path(robotree.vr.__file__).read_text())
    told = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("robotree.")
        for alias in node.names
    }
    assert set(told) == set(robotree.vr.__all__)
    for name, module in told.items():
        assert getattr(robotree.vr, name) is getattr(import_module(module), name)
        assert name in dir(robotree.vr)


def test_a_name_that_is_not_offered_is_an_error_as_in_any_module() -> None:
    with pytest.raises(AttributeError, match=r"module 'robotree.vr' has no attribute 'Robto'"):
        _ = robotree.vr.Robto  # type: ignore[attr-defined] # pyright: ignore[reportAttributeAccessIssue]


def test_a_program_that_only_joins_a_realm_loads_nothing_for_authors() -> None:
    code = (
        "import sys, robotree.vr.network.local; "
        "print([name for name in sys.modules if name.startswith('robotree.vr.author')])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
