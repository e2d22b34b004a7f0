"""The public names of `robotree.vr`, and what their import brings along."""

from __future__ import annotations

import subprocess
import sys
from types import ModuleType

from robotree import vr


def test_all_lists_exactly_the_public_names() -> None:
    public = {
        name
        for name, value in vars(vr).items()
        if not name.startswith("_") and not isinstance(value, ModuleType)
    }
    assert set(vr.__all__) == public
    assert len(vr.__all__) == len(public)


def test_a_page_of_python_needs_neither_network_nor_units() -> None:
    code = "import sys, robotree.vr; print({'zenoh', 'pint', 'sqlite3', 'ctypes'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
