"""The walks of CONTRIBUTING name what is there: each file, and each class and function in it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
WALKS = (ROOT / "CONTRIBUTING.md").read_text().partition("\n## Walks\n")[2].partition("\n## ")[0]
FILE = re.compile(r"`([\w./]+\.py)`(?:: |, )?")
NAME = re.compile(r"`([A-Z]\w+(?:\.\w+)?|[a-z_]+)`")
MADE_BY_THE_WALK = {"proxy/conveyor.py", "kinds/conveyor.py"}


def defined(path: Path) -> set[str]:
    """Return what a file defines at its top, and the methods of its classes as `Class.method`."""
    found = set[str]()
    for node in ast.parse(path.read_text()).body:
        match node:
            case ast.ClassDef():
                found |= {node.name}
                methods = [
                    each for each in node.body if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
                ]
                found |= {f"{node.name}.{each.name}" for each in methods}
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                found.add(node.name)
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                found.add(name)
            case _:
                pass
    return found


def test_every_file_of_a_walk_is_there() -> None:
    named = set(FILE.findall(WALKS)) - MADE_BY_THE_WALK
    assert len(named) > 30
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_every_class_and_method_of_a_walk_is_in_one_of_its_files() -> None:
    places = [ROOT / name for name in set(FILE.findall(WALKS)) - MADE_BY_THE_WALK]
    there = set[str]().union(*map(defined, places))
    named = {name for name in NAME.findall(WALKS) if name[0].isupper() and (name in there or "." in name)}
    assert len(named) > 40
    assert sorted(named - there) == []


def test_what_stands_behind_a_file_is_in_that_file() -> None:
    pairs = re.findall(r"`([\w./]+\.py)`: `([A-Za-z_]\w*(?:\.\w+)?)`", WALKS)
    assert len(pairs) > 35
    assert [pair for pair in pairs if pair[1] not in defined(ROOT / pair[0])] == []
