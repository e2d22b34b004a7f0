"""The tools that commands of robots become: names, JSON schemas, units, ranges and docs. Pure."""

from __future__ import annotations

import hashlib
import re
from typing import Any, Final, NamedTuple

from robotree.assistants.marking import said
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription
from robotree.vr.base.foreign import bounded

LONGEST_NAME: Final = 64
"""[characters] that common clients take for the name of a tool."""
WHY, WITHIN = "_why", "_within"
"""Arguments of each tool, beside those of its command: an underscore begins no parameter of a command."""
LONGEST_WITHIN: Final = 600.0
"""[s] that a command of an assistant may take at most."""
USUAL_WITHIN: Final = 60.0
_FIT = re.compile(r"[^A-Za-z0-9_-]")


class CommandTool(NamedTuple):
    """One command of one robot as a tool."""

    name: str
    robot: str
    spec: CommandSpec
    description: str
    schema: dict[str, Any]
    asks: bool
    """Whether each call needs a person's yes."""


def tool_name(robot: str, command: str) -> str:
    """Return the name of the tool of a command: `arm-1__go_to`; one that is too long ends with a hash."""
    name = f"{_FIT.sub('_', robot)}__{_FIT.sub('_', command)}"
    if len(name) <= LONGEST_NAME and ":" not in robot:
        return name
    digest = hashlib.sha256(f"{robot}.{command}".encode()).hexdigest()[:8]
    return f"{name[: LONGEST_NAME - 9]}_{digest}"


class CommandText(NamedTuple):
    """What the tools of a command have in common, whichever robot of a kind it belongs to."""

    name: str
    tail: str
    """Of the description: what follows the name of the robot."""
    schema: dict[str, Any]


def text_of(spec: CommandSpec, *, asks: bool) -> CommandText:
    """Return what the tools of a command have in common.

    Args:
        spec: the command.
        asks: whether each call needs a person's yes.
    """
    doubt = " Each call needs a person's yes: the answer names a permit, see robotree_permit." if asks else ""
    about = f" Its page says: {said(spec.doc)}." if spec.doc else ""
    returns = ", ".join(_brief(field) for field in spec.result)
    result = f" It returns {returns}." if returns else ""
    tail = f"{_EFFECTS[spec.effect]}{doubt}{about}{result}"
    return CommandText(bounded(spec.name), tail, schema_of(spec))


def tool_of(robot: RobotDescription, spec: CommandSpec, *, asks: bool, text: CommandText) -> CommandTool:
    """Return a command as a tool.

    Args:
        robot: whose it is.
        spec: the command.
        asks: whether each call needs a person's yes.
        text: of the command: `text_of`.
    """
    who = f"{bounded(robot.name)} ({bounded(robot.kind)})"
    description = f"Command {text.name} of robot {who}. {text.tail}"
    return CommandTool(tool_name(robot.name, spec.name), robot.name, spec, description, text.schema, asks)


_EFFECTS = {
    "read": "It only reads.",
    "repeat": "It moves or changes something; the same call again ends in the same state.",
    "once": "It moves or changes something; the same call again adds to it.",
}


def schema_of(spec: CommandSpec) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of the arguments of a command."""
    properties = {field.name: field_schema(field) for field in spec.parameters}
    required = [field.name for field in spec.parameters if field.required]
    properties[WHY] = {
        "type": "string",
        "minLength": 1,
        "maxLength": 300,
        "description": "Why you call this now, in one sentence: a person reads it, and it is kept.",
    }
    properties[WITHIN] = {
        "type": "number",
        "exclusiveMinimum": 0,
        "maximum": LONGEST_WITHIN,
        "default": USUAL_WITHIN,
        "description": "[s] within which it must be done; then it is ended.",
    }
    return {
        "type": "object",
        "properties": properties,
        "required": [*required, WHY],
        "additionalProperties": False,
    }


def field_schema(field: FieldSpec) -> dict[str, Any]:
    """Return the JSON schema of one parameter: its type, unit, range and doc."""
    schema = _typed(field)
    if field.unit:
        schema["description"] = f"in {bounded(field.unit, 20)}"
    if field.doc:
        schema["description"] = " ".join(filter(None, (schema.get("description", ""), said(field.doc))))
    if not field.required and isinstance(field.default, bool | int | float | str):
        schema["default"] = bounded(field.default) if isinstance(field.default, str) else field.default
    if field.optional and isinstance(schema.get("type"), str):
        schema["type"] = [schema["type"], "null"]
    return schema


def _typed(field: FieldSpec) -> dict[str, Any]:  # noqa: PLR0911 # one for each type
    match field.type:
        case "float" | "int":
            schema: dict[str, Any] = {"type": "number" if field.type == "float" else "integer"}
            if field.lower is not None:
                schema["minimum"] = field.lower
            if field.upper is not None:
                schema["maximum"] = field.upper
            return schema
        case "bool":
            return {"type": "boolean"}
        case "choice":
            return {"enum": [bounded(choice) for choice in field.choices]}
        case "list":
            return {"type": "array", "items": field_schema(field.items[0])}
        case "tuple":
            return {
                "type": "array",
                "prefixItems": [field_schema(each) for each in field.items],
                "minItems": len(field.items),
                "maxItems": len(field.items),
            }
        case "dict":
            return {"type": "object", "additionalProperties": field_schema(field.items[0])}
        case "record":
            return {
                "type": "object",
                "properties": {each.name: field_schema(each) for each in field.items},
                "required": [each.name for each in field.items if each.required],
                "additionalProperties": False,
            }
        case _:
            return {"type": "string"}


def _brief(field: FieldSpec) -> str:
    name, unit = bounded(field.name, 40), bounded(field.unit, 20)
    return " ".join(filter(None, (name or field.type, f"in {unit}" if unit else "")))
