"""The public names of `robotree.vr`, and what their import brings along."""

from __future__ import annotations

import ast
import inspect
import sys
from importlib import import_module

import pytest

from robotree import vr
from tests.command_line import ran


def test_each_public_name_is_the_one_that_a_type_checker_sees() -> None:
    tree = ast.parse(inspect.getsource(vr))
    imports = [
        node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module != "importlib"
    ]
    seen = {name.name: str(node.module) for node in imports for name in node.names}
    assert sorted(vr.__all__) == sorted(seen)
    for name, module in seen.items():
        assert getattr(vr, name) is getattr(import_module(module), name), name
        assert name in dir(vr)


def test_a_name_that_is_not_offered_is_an_error_as_in_any_module() -> None:
    with pytest.raises(AttributeError, match=r"module 'robotree.vr' has no attribute 'Robto'"):
        _ = vr.Robto  # type: ignore[attr-defined] # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    ("code", "printed"),
    [
        pytest.param(
            "from types import ModuleType; from robotree import vr;"
            "print(sorted(name for name in dir(vr) if not name.startswith('_') and name not in vr.__all__"
            " and not isinstance(getattr(vr, name), ModuleType)));"
            "print({'zenoh', 'pint', 'sqlite3', 'ctypes'} & set(sys.modules))",
            ["['TYPE_CHECKING']", "set()"],
            id="a page",
        ),
        pytest.param(
            "import robotree.vr.network.local;"
            "print([name for name in sys.modules if name.startswith('robotree.vr.author')])",
            ["[]"],
            id="a program that only joins a realm",
        ),
    ],
)
def test_nothing_is_loaded_or_named_that_is_not_needed(code: str, printed: list[str]) -> None:
    done = ran([sys.executable, "-c", f"import sys; {code}"], check=True)
    assert done.stdout.splitlines() == printed
