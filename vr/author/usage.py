"""Which commands of its children a page uses: what a slot expects of a child when its kind is only a name.

Read from the byte code of the class, so that nothing is parsed: `self.arm.go_to`, `self.rovers[0].move`,
`for rover in self.rovers: rover.move(…)`, and what is exposed. What is looked up in another way, such as by
`getattr`, is not known. Pure.
"""

from __future__ import annotations

import dis
import inspect
from collections.abc import Collection, Iterator
from types import CodeType, FunctionType
from typing import Any

_ATTRIBUTES = {"LOAD_ATTR", "LOAD_METHOD"}
_INDEXING = {"LOAD_CONST", "LOAD_FAST", "LOAD_SMALL_INT", "BINARY_SUBSCR", "BINARY_OP"}
READINGS = "readings"
"""The names that each child has beside its commands."""
_ITERATION = {"GET_ITER", "FOR_ITER"}


def used_commands(cls: type[Any], slots: Collection[str], groups: Collection[str]) -> dict[str, set[str]]:
    """Return the commands that the methods of a class use, by name of slot or group.

    Args:
        cls: of a virtual robot.
        slots: names of its slots that stand alone.
        groups: names of its groups.
    """
    used: dict[str, set[str]] = {name: set() for name in (*slots, *groups)}
    if not used:
        return used
    for code in _codes(cls):
        for slot, command in _uses(code, slots, groups):
            if command != READINGS:
                used[slot].add(command)
    return used


def _codes(cls: type[Any]) -> Iterator[CodeType]:
    """Yield the code of all methods of a class and of its bases, and of what is defined in them."""
    for base in cls.__mro__:
        for value in vars(base).values():
            function: Any = value.fget if isinstance(value, property) else value
            function = inspect.unwrap(function) if callable(function) else None
            if isinstance(function, FunctionType):
                yield from _nested(function.__code__)


def _nested(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _nested(constant)


def _uses(code: CodeType, slots: Collection[str], groups: Collection[str]) -> Iterator[tuple[str, str]]:
    if not {*code.co_names}.intersection((*slots, *groups)):
        return
    names: dict[str, str] = {}
    """Slot by name of the variable that holds its child."""
    before, deep = "", False
    """Slot that has just been loaded, and whether it is a child or still the group."""
    for instruction in dis.get_instructions(code):
        name = str(instruction.argval)
        if before and instruction.opname in _ATTRIBUTES and deep and not name.startswith("_"):
            yield before, name
            before = ""
        elif (
            instruction.opname in _ATTRIBUTES and before in groups and name not in {"items", "keys", "values"}
        ):
            yield before, name  # of all children of the group
            before = ""
        elif instruction.opname in _ATTRIBUTES:
            before, deep = (name, name in slots) if name in (*slots, *groups) else ("", False)
        elif before and instruction.opname in {"STORE_FAST", "STORE_DEREF"} and deep:
            names[name], before = before, ""
        elif before and instruction.opname in _INDEXING | _ITERATION and before in groups:
            deep = deep or instruction.opname in {"BINARY_SUBSCR", "BINARY_OP", "FOR_ITER"}
        elif instruction.opname in {"LOAD_FAST", "LOAD_DEREF", "LOAD_FAST_BORROW"} and name in names:
            before, deep = names[name], True
        else:
            before = ""
