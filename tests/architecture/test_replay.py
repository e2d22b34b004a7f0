"""What the World plays comes out the same each time: no order in it depends on a hash."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
REAL = {"network"}
"""Folders of transports between real processes, which never come out the same twice."""
IN_ORDER = {"list", "tuple", "iter", "gather", "wait", "enumerate", "map", "dict.fromkeys"}
"""Functions that take what they are given in its order."""
WITHOUT_ORDER = {"sorted", "any", "all", "sum", "min", "max", "set", "frozenset"}
"""Functions of which the result is the same in any order."""


def files() -> Iterator[Path]:
    for folder in ("vr", "proxy"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if REAL.isdisjoint(path.relative_to(ROOT).parts[:-1]):
                yield path


def sets_of(tree: ast.Module) -> set[str]:
    """Return the attributes that are declared to be sets, or dicts of sets."""
    return {
        node.target.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Attribute)
        and any(isinstance(part, ast.Name) and part.id == "set" for part in ast.walk(node.annotation))
    }


def walked_through(tree: ast.Module) -> Iterator[ast.expr]:
    """Yield each expression whose order decides what happens."""
    unordered = {
        one
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in WITHOUT_ORDER
        for one in node.args
    }
    for node in ast.walk(tree):
        if node in unordered:
            continue
        if isinstance(node, ast.For | ast.AsyncFor):
            yield node.iter
        elif isinstance(node, ast.ListComp | ast.GeneratorExp | ast.DictComp):
            yield from (each.iter for each in node.generators)
        elif isinstance(node, ast.Starred):
            yield node.value
        elif isinstance(node, ast.Call) and ast.unparse(node.func).removeprefix("asyncio.") in IN_ORDER:
            yield from node.args


def named(expression: ast.expr) -> str:
    """Return the attribute that an expression is, or of which it is a part; empty: it is another thing."""
    while not isinstance(expression, ast.Attribute):
        match expression:
            case ast.Subscript(value=inner) | ast.BinOp(left=inner) | ast.Await(value=inner):
                expression = inner
            case ast.Call(func=ast.Attribute(value=inner, attr="get" | "pop" | "setdefault")):
                expression = inner
            case _:
                return ""
    return expression.attr


def test_no_order_of_a_set_decides_what_happens() -> None:
    """Of objects it follows from where they lie in memory, of strings from a number of the process.

    Use a dict whose values are None, or `sorted`.
    """
    found: list[str] = []
    for path in files():
        tree = ast.parse(path.read_text())
        sets = sets_of(tree)
        found += [
            f"{path.relative_to(ROOT)}:{one.lineno}: {ast.unparse(one)}"
            for one in walked_through(tree)
            if named(one) in sets
        ]
    assert found == []
