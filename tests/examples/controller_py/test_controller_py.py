"""The controller in plain Python, driven, stopped and left by the real proxy of a rover."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.e2e
SOURCE = Path(__file__).parents[3] / "examples" / "controller_py" / "controller.py"
PAGE = 113
"""Lines of code; blank ones and the first words do not count."""


def test_it_is_one_page_and_needs_nothing_but_pymavlink() -> None:
    text = SOURCE.read_text()
    code = text.split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= PAGE
    tree = ast.walk(ast.parse(text))
    names = {
        alias.name if isinstance(each, ast.Import) else each.module
        for each in tree
        if isinstance(each, ast.Import | ast.ImportFrom)
        for alias in each.names
    }
    assert names - sys.stdlib_module_names == {"rover_wire", "keys", "memory"}, (
        "pymavlink generates one, the others are here"
    )
