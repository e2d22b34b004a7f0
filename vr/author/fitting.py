"""What a slot expects of a child: which commands the page uses, and whether a robot fits. Pure."""

from __future__ import annotations

import dis
import inspect
from collections.abc import Collection, Iterable, Iterator
from types import CodeType, FunctionType
from typing import Any

from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription, offered


def misfit(robot: RobotDescription, promises: Iterable[CommandSpec], uses: Iterable[str]) -> str:
    """Return why a robot does not keep what a slot expects, as a clause; empty: it does.

    Args:
        robot: as it describes itself.
        promises: commands that the kind of the slot promises, in full.
        uses: names of commands that the parent's page uses.
    """
    return next(_reasons(robot, promises, uses), "")


def _reasons(robot: RobotDescription, promises: Iterable[CommandSpec], uses: Iterable[str]) -> Iterator[str]:
    known = {command.name: command for command in robot.commands}
    for name in uses:
        if name not in known:
            yield f"has no command {name}, which the page uses; it has: {offered(known, name)}"
    for promise in promises:
        command = known.get(promise.name)
        if command is None:
            yield f"has no command {promise.name}; it has: {offered(known, promise.name)}"
        elif command.available:  # of an exposed one nothing is known while its slot is empty
            yield from (
                f"has a command {promise.name} that {difference}"
                for difference in _differences(command, promise)
            )


def _differences(command: CommandSpec, promise: CommandSpec) -> Iterator[str]:
    """Say what of a command breaks its promise."""
    takes = {field.name: field for field in command.parameters}
    for field in promise.parameters:
        own = takes.pop(field.name, None)
        if own is None:
            yield f"takes no {field.name}"
        elif not _takes(own, field):
            yield f"takes {field.name} as {_type_of(own)} instead of {_type_of(field)}"
        elif own.required and not field.required:
            yield f"cannot do without {field.name}"
    yield from (f"also needs {own.name}" for own in takes.values() if own.required)
    gives = {field.name: field for field in command.result}
    for field in promise.result:
        own = gives.get(field.name)
        if own is None:
            yield f"returns no {field.name or 'single value'}"
        elif not _takes(field, own):
            yield f"returns {field.name or 'a value'} as {_type_of(own)} instead of {_type_of(field)}"


def _takes(own: FieldSpec, given: FieldSpec) -> bool:
    """Whether what is meant by one description is taken under the other; ranges belong to each robot."""
    if own.unit != given.unit or (given.nullable and not own.optional):
        return False
    match own.type, given.type:
        case ("float", "int") | ("str", "choice"):
            return True
        case "choice", "choice":
            return set(given.choices) <= set(own.choices)
        case "record", "record":
            return _takes_parts(own, given)
        case one, other:
            same = one == other and len(own.items) == len(given.items)
            return same and all(map(_takes, own.items, given.items))


def _takes_parts(own: FieldSpec, given: FieldSpec) -> bool:
    parts = {part.name: part for part in own.items}
    needed = {part.name for part in own.items if part.required}
    named = {part.name for part in given.items if part.required}
    return needed <= named and all(
        part.name in parts and _takes(parts[part.name], part) for part in given.items
    )


def _type_of(field: FieldSpec) -> str:
    kind = f"one of {', '.join(field.choices)}" if field.type == "choice" else field.type
    return f"{kind} in {field.unit}" if field.unit else kind


# -- which commands a page uses ----------------------------------------------------------------------


_ATTRIBUTES = {"LOAD_ATTR", "LOAD_METHOD"}
_INDEXING = {"LOAD_CONST", "LOAD_FAST", "LOAD_SMALL_INT", "BINARY_SUBSCR", "BINARY_OP"}
READINGS = "readings"
"""The names that each child has beside its commands."""
_ITERATION = {"GET_ITER", "FOR_ITER"}


def used_commands(cls: type[Any], slots: Collection[str], groups: Collection[str]) -> dict[str, set[str]]:
    """Return the commands that the methods of a class use, by name of slot or group.

    A slot expects them of a child when its kind is only a name. They are read from the byte code of the
    class, so that nothing is parsed: `self.arm.go_to`, `self.rovers[0].move`, `for rover in self.rovers:
    rover.move(…)`, and what is exposed. What is looked up in another way, such as by `getattr`, is not known.

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
