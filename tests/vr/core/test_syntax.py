"""A page is read into a tree whatever else its process does meanwhile."""

from __future__ import annotations

import ast
import gc
from collections.abc import Iterator
from typing import Any

import pytest

from robotree.vr.bundle.syntax import parse, parse_expression

PAGE = "".join(f"def f{n}(a, b=({n}, [1, {{2: 3}}])):\n    return a.b[{n}](*a, **b)\n" for n in range(50))


@pytest.fixture
def collected() -> Iterator[list[ast.Module]]:
    """Collect garbage again and again, and make a tree each time, as a finalizer of another thread may do."""
    made: list[ast.Module] = []

    def meanwhile(phase: str, info: dict[str, Any]) -> None:
        del phase, info
        made.append(ast.parse("x = 1"))

    usual = gc.get_threshold()
    gc.callbacks.append(meanwhile)
    gc.set_threshold(5)
    yield made
    gc.set_threshold(*usual)
    gc.callbacks.remove(meanwhile)


def test_garbage_that_is_collected_meanwhile_breaks_no_page(collected: list[ast.Module]) -> None:
    """In CPython 3.11.7 `ast.parse` ends with a SystemError here."""
    assert len(parse(PAGE).body) == 50
    assert isinstance(parse_expression("a + 1"), ast.BinOp)
    gc.collect()
    assert collected, "garbage is collected again"


def test_garbage_is_collected_again_after_a_mistake() -> None:
    with pytest.raises(SyntaxError):
        parse("def")
    assert gc.isenabled()
    with pytest.raises(SyntaxError):
        parse_expression("1 +")
    assert gc.isenabled()
