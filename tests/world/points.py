"""Points at which a thread can lose the processor before every statement of chosen modules.

Without them threads only change at locks, system calls and the journal, so that nobody comes between two
statements that a lock should keep together. Real threads change anywhere.
"""

from __future__ import annotations

import ast
import contextlib
import inspect
from collections.abc import Callable, Generator, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

_NAME = "__point__"
_BLOCKS = ("body", "orelse", "finalbody")


class _Pointed(ast.NodeTransformer):
    """Puts a call before each statement in functions."""

    def __init__(self) -> None:
        self._inside = 0

    def generic_visit(self, node: ast.AST) -> ast.AST:
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        self._inside += is_function
        super().generic_visit(node)
        for block in _BLOCKS if self._inside else ():
            statements = getattr(node, block, None)
            if isinstance(statements, list) and not isinstance(node, ast.ClassDef):
                setattr(
                    node,
                    block,
                    [each for statement in statements for each in (_point_before(statement), statement)],
                )
        self._inside -= is_function
        return node


def _point_before(statement: ast.stmt) -> ast.stmt:
    call = ast.Expr(ast.Call(ast.Name(_NAME, ast.Load()), [], []))
    return ast.fix_missing_locations(ast.copy_location(call, statement))


def _codes(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _codes(constant)


@cache
def _pointed(module: ModuleType) -> dict[tuple[str, int], CodeType]:
    """Return the code of a module with its points, by name and line."""
    tree = _Pointed().visit(ast.parse(inspect.getsource(module)))
    whole = compile(tree, module.__file__ or "", "exec", flags=0, dont_inherit=True)
    return {(code.co_name, code.co_firstlineno): code for code in _codes(whole)}


def _functions(module: ModuleType) -> Iterator[FunctionType]:
    for var in vars(module).values():
        if inspect.isclass(var) and var.__module__ == module.__name__:
            members: list[Any] = list(vars(var).values())
        else:
            members = [var]
        for member in members:
            for found in (member, getattr(member, "fget", None), getattr(member, "__func__", None)):
                if isinstance(found, FunctionType) and found.__module__ == module.__name__:
                    yield found


def codes_of(module: ModuleType) -> dict[CodeType, str]:
    """Return the functions of a module, with their names."""
    place = module.__name__.rpartition(".")[2]
    return {function.__code__: f"{place}.{function.__qualname__}" for function in _functions(module)}


@contextlib.contextmanager
def at_every_statement(modules: tuple[ModuleType, ...], point: Callable[[], object]) -> Generator[None]:
    """Call `point` before every statement of the functions of some modules inside the block."""
    with contextlib.ExitStack() as stack:
        for module in modules:
            pointed = _pointed(module)
            vars(module)[_NAME] = point
            stack.callback(vars(module).pop, _NAME)
            for function in _functions(module):
                before = function.__code__
                after = pointed.get((before.co_name, before.co_firstlineno))
                if after is not None and after.co_freevars == before.co_freevars:
                    function.__code__ = after
                    stack.callback(setattr, function, "__code__", before)
        yield
