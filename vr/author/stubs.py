"""Writes the interface of a robot as a page of Python: what `robotree stubs NAME` prints.

The page has a class derived from `Kind` with one method for each command, and a dataclass for each result of
several parts. Editors and type checkers understand it; `arm = Child(Arm)` takes it at run time. Pure.
"""

from __future__ import annotations

import keyword
from collections.abc import Iterator
from textwrap import indent

from robotree.vr.author.child import WITHIN
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription

_TYPES = {"float": "float", "int": "int", "bool": "bool", "str": "str", "bytes": "bytes"}
_QUOTES = '"""'
_OURS = {"Range": "(", "Unit": "(", "Within": " ="}
"""Names of `robotree.vr`, and what follows them where they are used."""


def interface(robot: RobotDescription, *, origin: str) -> str:
    """Return the source of a module with the interface of a robot.

    Args:
        robot: as it describes itself. An exposed command of an empty slot is left out: it is not known.
        origin: what wrote it, for its first line.
    """
    page = _Page()
    body = "\n".join(page.commands(robot)) or "    pass\n"
    used = "".join([*page.records, body])
    ours = [name for name, sign in _OURS.items() if f"{name}{sign}" in used]
    names = [name for name in ("Annotated", "Literal") if f"{name}[" in used]
    lines = [
        f"{_QUOTES}The interface of {robot.kind}. {origin}{_QUOTES}\n",
        "from __future__ import annotations\n",
    ]
    lines.append("from dataclasses import dataclass" if page.records else "")
    lines.append(f"from typing import {', '.join(names)}\n" if names else "")
    lines.append(f"from robotree.vr import {', '.join(['Kind', *ours, 'promised'])}\n\n")
    lines += page.records
    lines.append(f"class {robot.kind}(Kind):\n{indent(_doc(robot.doc), '    ')}\n\n{body}")
    return "\n".join(line for line in lines if line)


class _Page:
    def __init__(self) -> None:
        self.records: list[str] = []

    def commands(self, robot: RobotDescription) -> Iterator[str]:
        """Yield the methods; the records that they need are collected."""
        for command in robot.commands:
            if command.available and _usable(command):
                yield indent(self._method(robot.kind, command), "    ")

    def _method(self, kind: str, command: CommandSpec) -> str:
        name = kind + _title(command.name.removeprefix("get_"))
        mark = "@promised" if command.effect == "once" else f'@promised(effect="{command.effect}")'
        ordered = sorted(command.parameters, key=lambda field: not field.required)
        parameters = [self._parameter(f"{name}{_title(field.name)}", field) for field in ordered]
        if WITHIN not in command.by_name:
            parameters += ["*", f"{WITHIN}: Within = None"]
        listed = "".join(f"    {parameter},\n" for parameter in parameters)
        plain = f"def {command.name}({', '.join(['self', *parameters])})"
        head = f"def {command.name}(\n    self,\n{listed})" if command.parameters else plain
        body = indent(f"{_doc(command.doc)}\nraise NotImplementedError\n", "    ")
        return f"{mark}\n{head} -> {self._result(name, command)}:\n{body}"

    def _parameter(self, name: str, field: FieldSpec) -> str:
        typed = self._type(name, field)
        if field.required:
            return f"{field.name}: {typed}"
        shown = _default(field)
        missing = shown == "None" and not field.nullable
        return f"{field.name}: {typed}{' | None' if missing else ''} = {shown}"

    def _result(self, name: str, command: CommandSpec) -> str:
        if not command.result:
            return "None"
        if len(command.result) == 1 and not command.result[0].name:
            return self._type(name, command.result[0])
        return self._record(name if command.name.startswith("get_") else f"{name}Result", command.result)

    def _record(self, name: str, parts: tuple[FieldSpec, ...]) -> str:
        ordered = sorted(parts, key=lambda field: not field.required)
        fields = [self._parameter(f"{name}{_title(part.name)}", part) for part in ordered]
        body = "".join(f"    {field}\n" for field in fields)
        record = f"@dataclass(kw_only=True)\nclass {name}:\n    {_QUOTES}Values by name.{_QUOTES}\n\n{body}\n"
        if record not in self.records:
            self.records.append(record)
        return name

    def _type(self, name: str, field: FieldSpec) -> str:
        match field.type:
            case "choice":
                typed = f"Literal[{', '.join(map(repr, field.choices))}]"
            case "list":
                typed = f"list[{self._type(name, field.items[0])}]"
            case "tuple":
                parts = (self._type(f"{name}{at}", one) for at, one in enumerate(field.items))
                typed = f"tuple[{', '.join(parts)}]"
            case "dict":
                typed = f"dict[str, {self._type(name, field.items[0])}]"
            case "record":
                typed = self._record(name, field.items)
            case simple:
                typed = _TYPES[simple]
        said = [f"Unit({field.unit!r})"] if field.unit else []
        if field.lower is not None or field.upper is not None:
            said.append(f"Range({field.lower!r}, {field.upper!r})")
        said += [repr(field.doc)] if field.doc else []
        typed = f"Annotated[{', '.join([typed, *said])}]" if said else typed
        return f"{typed} | None" if field.nullable else typed


def _default(field: FieldSpec) -> str:
    """Return how a default is written; one with records in it is left open."""
    if any(one.type == "record" for one in (field, *field.items)):
        return "None"
    return repr(tuple(field.default)) if field.type == "tuple" and field.default else repr(field.default)


def _usable(command: CommandSpec) -> bool:
    names = [command.name, *(field.name for field in (*command.parameters, *command.result) if field.name)]
    return all(name.isidentifier() and not keyword.iskeyword(name) for name in names)


def _title(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _doc(text: str) -> str:
    shown = text.replace("\\", "\\\\").replace(_QUOTES, "'''") or "See the robot."
    return f"{_QUOTES}{shown}\n{_QUOTES}" if "\n" in shown else f"{_QUOTES}{shown}{_QUOTES}"
