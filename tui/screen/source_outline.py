"""Which virtual robots a source file defines, read without running it. Pure.

What is seen here is only offered to a person; the host that creates the robot has the last word.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass

ROOT = "VirtualRobot"


@dataclass(frozen=True, slots=True)
class ClassOutline:
    """A virtual robot in a source file."""

    name: str
    doc: str
    slots: tuple[tuple[str, str], ...]
    """Name and kind of each child slot."""
    commands: tuple[str, ...]
    """Names of the commands."""


def outline(source: str) -> list[ClassOutline]:
    """Return the virtual robots of a source, in its order.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    found: dict[str, ClassOutline] = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef) and any(_leads_to_root(base, found) for base in node.bases):
            found[node.name] = _outlined(node)
    return list(found.values())


def _leads_to_root(base: ast.expr, found: dict[str, ClassOutline]) -> bool:
    name = _last_name(base)
    return name == ROOT or name in found


def _last_name(node: ast.expr) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case ast.Call(func=function):
            return _last_name(function)
        case _:
            return ""


def _outlined(node: ast.ClassDef) -> ClassOutline:
    slots: list[tuple[str, str]] = []
    commands: list[str] = []
    for item in node.body:
        match item:
            case ast.FunctionDef(name=name, decorator_list=marks) if any(
                _last_name(one) == "command" for one in marks
            ):
                commands.append(name)
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call() as call):
                _take_call(name, call, slots, commands)
            case _:
                pass
    return ClassOutline(node.name, ast.get_docstring(node) or "", tuple(slots), tuple(commands))


def _take_call(name: str, call: ast.Call, slots: list[tuple[str, str]], commands: list[str]) -> None:
    called = _last_name(call.func)
    if called == "Child" and call.args and isinstance(call.args[0], ast.Constant):
        slots.append((name, str(call.args[0].value)))
    elif called == "exposed":
        commands.append(name)


def suggested_name(class_name: str, taken: frozenset[str]) -> str:
    """Return a name for a robot of a class: `OpenCloseLever` becomes `open-close-lever`, or `…-2`."""
    letters: list[str] = []
    for letter in class_name:
        if letter.isupper() and letters and letters[-1] != "-":
            letters.append("-")
        letters.append(letter.lower())
    name = "".join(letters)[:60]
    number = 2
    chosen = name
    while chosen in taken:
        chosen, number = f"{name}-{number}", number + 1
    return chosen
