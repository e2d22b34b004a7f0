"""Which virtual robots a source file defines, read without running it. Pure.

What is seen here is only offered to a person; the host that creates the robot has the last word.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import GenericAlias
from typing import Annotated, Any, Literal, Union

from robotree.vr.author.signature import field_with_default
from robotree.vr.base.description import FieldSpec
from robotree.vr.base.units import Range, Unit
from robotree.vr.bundle.syntax import parse, parse_expression

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
    settings: tuple[FieldSpec, ...] = ()
    """Those whose types can be read without running the source."""


def outline(source: str) -> list[ClassOutline]:
    """Return the virtual robots of a source, in its order.

    Raises:
        SyntaxError: it is no Python.
        ValueError: it has null bytes.
    """
    found: dict[str, ClassOutline] = {}
    aliases: dict[str, ast.expr] = {}
    for node in parse(source).body:
        match node:
            case ast.ClassDef() if any(_leads_to_root(base, found) for base in node.bases):
                settings = {
                    setting.name: setting
                    for base in reversed(node.bases)
                    if _last_name(base) in found
                    for setting in found[_last_name(base)].settings
                }
                settings |= _settings(node, aliases)
                found[node.name] = replace(_outlined(node), settings=tuple(settings.values()))
            case ast.ClassDef() if any(_last_name(base) in {"Enum", "StrEnum"} for base in node.bases):
                aliases |= _members(node)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                aliases[name] = value
            case _:
                pass
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
                _last_name(mark) == "command" for mark in marks
            ):
                commands.append(name)
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call() as call):
                _take_call(name, call, slots, commands)
            case _:
                pass
    return ClassOutline(node.name, ast.get_docstring(node) or "", tuple(slots), tuple(commands))


def _take_call(name: str, call: ast.Call, slots: list[tuple[str, str]], commands: list[str]) -> None:
    called = _last_name(call.func)
    if called in {"Child", "Watch"} and call.args and isinstance(call.args[0], ast.Constant):
        slots.append((name, str(call.args[0].value)))
    elif called == "exposed":
        commands.append(name)


def _members(node: ast.ClassDef) -> dict[str, ast.expr]:
    """Return what an Enum and its members mean: the choice between their values, and each value."""
    values: dict[str, ast.expr] = {
        one.targets[0].id: one.value
        for one in node.body
        if isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name)
    }
    choice = ast.Subscript(ast.Name("Literal"), ast.Tuple(list(values.values())))
    return {node.name: choice, **{f"{node.name}.{name}": value for name, value in values.items()}}


# -- settings --------------------------------------------------------------------------------------

_TYPES: Mapping[str, Any] = {"float": float, "int": int, "bool": bool, "str": str, "None": None}


def _settings(node: ast.ClassDef, aliases: Mapping[str, ast.expr]) -> dict[str, FieldSpec]:
    """Return the settings that a class declares, by name; see `robotree.vr.author.fields`."""
    found: dict[str, FieldSpec] = {}
    for item in node.body:
        match item:
            case ast.AnnAssign(target=ast.Name(id=name), annotation=written, value=ast.expr() as value) if (
                not name.startswith("_")
            ):
                try:
                    default = ast.literal_eval(aliases.get(ast.unparse(value), value))
                    annotation = _annotation(written, aliases)
                    found[name] = field_with_default(name, annotation, default, name, node.name)
                except (ValueError, TypeError, SyntaxError, RecursionError):
                    continue  # no setting, or of a type that only the running source knows
            case _:
                pass
    return found


def _annotation(node: ast.expr, aliases: Mapping[str, ast.expr]) -> Any:
    """Return the type that an annotation means.

    Raises:
        ValueError: it has a part that cannot be read without running the source.
        TypeError: a unit or a range is none.
    """
    match node:
        case ast.Name(id=name) if name in _TYPES:
            return _TYPES[name]
        case ast.Name(id=name) if name in aliases:
            return _annotation(aliases[name], {one: each for one, each in aliases.items() if one != name})
        case ast.Constant(value=text):
            if text is None or text is ...:
                return text
            return _annotation(parse_expression(str(text)), aliases)
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            return Union[_annotation(left, aliases), _annotation(right, aliases)]  # noqa: UP007 # known at run time
        case ast.Subscript(value=outer, slice=inner):
            return _subscribed(
                _last_name(outer), inner.elts if isinstance(inner, ast.Tuple) else [inner], aliases
            )
        case _:
            pass
    raise ValueError(ast.unparse(node))


def _subscribed(outer: str, parts: list[ast.expr], aliases: Mapping[str, ast.expr]) -> Any:
    """Return what `Literal[…]` and `Annotated[…]` mean; errors as those of `_annotation`."""
    if outer == "Literal":
        return Literal[tuple(ast.literal_eval(part) for part in parts)]
    if outer == "tuple":
        return GenericAlias(tuple, tuple(_annotation(part, aliases) for part in parts))
    if outer == "Annotated":
        return Annotated[(_annotation(parts[0], aliases), *map(_extra, parts[1:]))]
    raise ValueError(outer)


def _extra(node: ast.expr) -> Unit | Range | str:
    """Return what an annotation says beside the type: a unit, a range or a text."""
    if isinstance(node, ast.Call) and (made := _last_name(node.func)) in {"Unit", "Range"}:
        given = [ast.literal_eval(one) for one in node.args]
        named = {keyword.arg: ast.literal_eval(keyword.value) for keyword in node.keywords if keyword.arg}
        return Unit(*given, **named) if made == "Unit" else Range(*given, **named)
    return str(ast.literal_eval(node))


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
