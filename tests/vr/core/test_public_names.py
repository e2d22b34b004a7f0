"""The public names of `robotree.vr`, and what their import brings along."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from importlib import import_module

from robotree import vr


def test_each_public_name_is_the_one_that_a_type_checker_sees() -> None:
    tree = ast.parse(inspect.getsource(vr))
    imports = [
        node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module != "importlib"
    ]
    seen = {name.name: str(node.module) for node in imports for name in node.names}
    assert sorted(vr.__all__) == sorted(seen)
    for name, module in seen.items():
        assert getattr(vr, name) is getattr(import_module(module), name), name


def test_dir_adds_no_public_name_but_modules() -> None:
    code = (
        "from types import ModuleType; from robotree import vr;"
        "print(sorted(name for name in dir(vr) if not name.startswith('_') and name not in vr.__all__"
        " and not isinstance(getattr(vr, name), ModuleType)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['TYPE_CHECKING']"


def test_a_page_of_python_needs_neither_network_nor_units() -> None:
    code = "import sys, robotree.vr; print({'zenoh', 'pint', 'sqlite3', 'ctypes'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
