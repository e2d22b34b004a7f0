"""From XML to the source of the typed messages: `robotree/protocol/messages/__init__.py`.

Our own messages and enumerations are generated whole, with their descriptions. Of the base dialects only what
robotree speaks is generated, as listed here; fields, types, units and numbers come from the XML, the one
sentence that describes each message or enumeration is ours.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from robotree.protocol.dialect.table import SECRETS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pymavlink.generator.mavparse import MAVXML, MAVEnum, MAVEnumEntry, MAVField, MAVType

OURS = "ROBOTREE_"
MESSAGES = {
    "HEARTBEAT": "A component is present, and how it is.",
    "SYS_STATUS": "Load, power supply and errors.",
    "SYSTEM_TIME": "The wall clock, and the time since start.",
    "PING": "A question (both targets are 0), or its answer.",
    "SET_MODE": "The old way to ask for a mode, before the command DO_SET_MODE.",
    "PARAM_REQUEST_READ": "Asks for one parameter, by its name if the index is -1.",
    "PARAM_REQUEST_LIST": "Asks for all parameters.",
    "PARAM_VALUE": "The value of one parameter.",
    "PARAM_SET": "Sets one parameter.",
    "PARAM_ERROR": "Why a parameter was not read or set.",
    "LOCAL_POSITION_NED": "Position and velocity of a mobile base: x north, y east, z down.",
    "MISSION_REQUEST_LIST": "Asks how many mission items there are.",
    "MISSION_COUNT": "How many mission items there are.",
    "REQUEST_DATA_STREAM": "The old way to ask for a rate.",
    "COMMAND_INT": "Asks for an action, with five numbers and two integers.",
    "COMMAND_LONG": "Asks for an action, with seven numbers; NaN means the default.",
    "COMMAND_ACK": "The answer to a command; progress is a percentage, 255 if it is unknown.",
    "COMMAND_CANCEL": "Ends a command that is in progress.",
    "TIMESYNC": "A question (tc1 is 0) or an answer of the time synchronisation.",
    "DATA_TRANSMISSION_HANDSHAKE": "Announces a picture, which follows in messages ENCAPSULATED_DATA.",
    "ENCAPSULATED_DATA": "A piece of a picture.",
    "AUTOPILOT_VERSION": "Which program answers, and what it can do.",
    "MESSAGE_INTERVAL": "How often a message is sent; -1: not at all, 0: there is no such message.",
    "NAMED_VALUE_FLOAT": "A number with a name.",
    "STATUSTEXT": "A sentence for people, or a chunk of one.",
    "SETUP_SIGNING": "Hands out a signing key, in the clear.",
    "PROTOCOL_VERSION": "Which versions of MAVLink are spoken, times 100.",
    "COMPONENT_METADATA": "Where the general metadata of a component are, and their CRC32.",
    "AVAILABLE_MODES": "One of the modes that a component has.",
    "CURRENT_MODE": "The mode that a component is in.",
    "CONTROL_STATUS": "Which ground station is in control.",
}
"""The messages of the base dialects that robotree speaks, with our description."""
ENUMS = {
    "MAV_TYPE": (
        "Kinds of systems. There is none for an arm: an arm is GENERIC.",
        "GENERIC GCS GROUND_ROVER ONBOARD_CONTROLLER CAMERA GRIPPER",
    ),
    "MAV_AUTOPILOT": ("Kinds of autopilots.", "GENERIC INVALID"),
    "MAV_STATE": ("States of a system.", ""),
    "MAV_MODE_FLAG": (
        "Parts of a mode. HIL_ENABLED: nothing real moves, the controller drives a simulation.",
        "CUSTOM_MODE_ENABLED HIL_ENABLED SAFETY_ARMED",
    ),
    "MAV_SEVERITY": ("Severities of a sentence, as in RFC 5424.", ""),
    "MAV_COMPONENT": (
        "Components of a system.",
        "ALL AUTOPILOT1 CAMERA CAMERA2 MISSIONPLANNER ONBOARD_COMPUTER",
    ),
    "MAVLINK_DATA_STREAM_TYPE": ("Formats of a picture.", "IMG_JPEG"),
    "MAV_CMD": (
        "Actions that a command asks for.",
        (
            "DO_SET_MODE DO_FLIGHTTERMINATION DO_SET_ACTUATOR DO_PAUSE_CONTINUE DO_GRIPPER "
            "PREFLIGHT_REBOOT_SHUTDOWN COMPONENT_ARM_DISARM GET_MESSAGE_INTERVAL SET_MESSAGE_INTERVAL "
            "REQUEST_MESSAGE REQUEST_PROTOCOL_VERSION REQUEST_AUTOPILOT_CAPABILITIES REQUEST_OPERATOR_CONTROL"
        ),
    ),
    "MAV_RESULT": ("Results of a command.", ""),
    "GRIPPER_ACTIONS": ("Actions of DO_GRIPPER.", ""),
    "MAV_PARAM_TYPE": ("Types of a parameter. Ours are all REAL32.", "REAL32"),
    "MAV_PARAM_ERROR": ("Why a parameter was not read or set.", ""),
    "MAV_PROTOCOL_CAPABILITY": (
        "Optional parts of the protocol.",
        (
            "COMMAND_INT FTP FLIGHT_TERMINATION MAVLINK2 PARAM_ENCODE_C_CAST "
            "COMPONENT_ACCEPTS_GCS_CONTROL GRIPPER"
        ),
    ),
    "MAV_MODE_PROPERTY": ("Properties of a mode.", ""),
    "GCS_CONTROL_STATUS_FLAGS": ("Parts of the operator control's state.", ""),
}
"""Their enumerations, with our description and the entries that are needed; none named: all of them.

An enumeration takes 7 us an entry to import, and MAV_CMD has 175. Of all of them our own entries are there.
"""
NAMES = {"SET_MODE": "LegacySetMode", "MAVLINK_DATA_STREAM_TYPE": "DataStreamType"}
"""Class names that do not follow from the message or enumeration; `SetMode` is ROBOTREE_SET_MODE."""
PREFIXES = {
    "MAVLINK_DATA_STREAM_TYPE": "MAVLINK_DATA_STREAM_",
    "MAV_COMPONENT": "MAV_COMP_ID_",
    "GRIPPER_ACTIONS": "GRIPPER_ACTION_",
}
"""Prefixes of the entries of an enumeration that do not begin with its name."""
OPTIONAL = {
    "SYS_STATUS": {f"errors_count{i}" for i in range(1, 5)},
    "PING": {"target_system", "target_component"},
    "PROTOCOL_VERSION": {"spec_version_hash", "library_version_hash"},
    "CONTROL_STATUS": {"gcs_secondary"},
}
"""Fields that may be left out and are 0 then, though they are no extensions."""
FINITE = {"ROBOTREE_JOINTS", "ROBOTREE_TOOL", "ROBOTREE_GRIPPER"}
"""Messages in which NaN and infinity have no meaning, and must not be sent."""
UNITS = {"[d%]": "[0.1 %]", "[c%]": "[0.01 %]", "[cA]": "[0.01 A]", "[degE7]": "[1e-7 deg]"}
"""Units that MAVLink writes with a prefix that SI does not have here."""
BEHAVIOUR = {"ROBOTREE_GOAL_STATE": "GoalStateBase"}
"""Base classes of enumerations, in `messages/base.py`, that add properties."""

HEADER = '''\
"""Frozen, typed messages: all of robotree.xml, and what robotree speaks of MAVLink's base dialects.

Generated by `python -m robotree.protocol.dialect`; do not edit. What is written by hand is in `base`.
A field of an enumeration may hold a number that the enumeration does not have.
"""
# ruff: noqa: I001  one import statement, whose names are exported again

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import ClassVar

from robotree.protocol.messages.base import (
{imports}
)
'''
EXPORTED = (
    "TYPED",
    "AnyMessage",
    "Message",
    "Untyped",
    "definition_of",
    "fields_of",
    "make",
    "wire",
)
"""Names of `messages/base.py` that are imported from here."""
INHERITED = ("SecretMessage", *BEHAVIOUR.values())
"""Names of `messages/base.py` from which classes here are made."""
WIDTH = 110


def source(parsed: list[MAVXML]) -> str:
    """The module of the typed messages.

    Args:
        parsed: a dialect and all that it includes.

    Raises:
        KeyError: the dialect lacks a message, an enumeration or an entry that is listed here.
    """
    messages = {each.name: each for file in parsed for each in file.message}
    enums = entries_by_enum(parsed)
    chosen = [messages[name] for name in MESSAGES] + [m for n, m in messages.items() if n.startswith(OURS)]
    typed = [*ENUMS, *(name for name in enums if name.startswith(OURS))]
    chosen.sort(key=lambda each: each.id)
    blocks = [_enum(name, *enums[name]) for name in typed]
    blocks += [_message(message, set(typed)) for message in chosen]
    names = {**{name: f"{name} as {name}" for name in EXPORTED}, **{name: name for name in INHERITED}}
    imports = "\n".join(f"    {names[name]}," for name in sorted(names, key=_import_order))
    return HEADER.replace("{imports}", imports) + "\n\n" + "\n\n\n".join(blocks) + "\n"


def _import_order(name: str) -> tuple[int, str]:
    """Constants, classes, functions: as the linter sorts imported names."""
    return 0 if name.isupper() else 1 if name[0].isupper() else 2, name


def entries_by_enum(parsed: list[MAVXML]) -> dict[str, tuple[MAVEnum, list[MAVEnumEntry]]]:
    """Each enumeration with the entries that all files give it, by value."""
    found: dict[str, tuple[MAVEnum, list[MAVEnumEntry]]] = {}
    for enum in (each for file in parsed for each in file.enum):
        first, entries = found.setdefault(enum.name, (enum, []))
        known = {entry.name for entry in entries}
        entries += [entry for entry in enum.entry if not entry.end_marker and entry.name not in known]
        if not first.description:
            found[enum.name] = enum, entries
    for _, entries in found.values():
        entries.sort(key=lambda entry: entry.value)
    return found


def _class_name(name: str) -> str:
    return NAMES.get(name) or name.removeprefix(OURS).title().replace("_", "")


def _enum(name: str, enum: MAVEnum, entries: list[MAVEnumEntry]) -> str:
    description, wanted = ENUMS.get(name, (enum.description, ""))
    prefix = PREFIXES.get(name, f"{name}_")
    short = {entry.name.removeprefix(prefix): entry for entry in entries}
    if wanted:
        ours = {each for each in short if each.startswith(OURS)}
        needed = {*wanted.split(), *ours}
        if missing := needed - short.keys():
            raise KeyError(f"{name} has no {', '.join(sorted(missing))}")
        short = {each: entry for each, entry in short.items() if each in needed}
    base = BEHAVIOUR.get(name, "IntFlag" if enum.bitmask else "IntEnum")
    text = f"{name}: {description[:1].lower()}{description[1:]}"
    lines = [f"class {_class_name(name)}({base}):", *_docstring(text), ""]
    for each, entry in short.items():
        lines.append(f"    {each} = {entry.value}")
        if name.startswith(OURS) or each.startswith(OURS):
            lines += _docstring(f"{entry.description} {_params(entry)}")
    return "\n".join(lines)


def _params(entry: MAVEnumEntry) -> str:
    """The parameters of a command."""
    used = [each for each in entry.param if each.label]
    lines = [f"param{each.index} {each.label.lower()} [{each.units}]: {each.description}" for each in used]
    return " ".join(lines)


def _message(message: MAVType, enums: set[str]) -> str:
    description = MESSAGES.get(message.name, message.description)
    base = "SecretMessage" if message.name in SECRETS else "Message"
    lines = [
        f'@wire("{message.name}")',
        f"class {_class_name(message.name)}({base}, frozen=True, gc=False):",
        *_docstring(description),
        "",
    ]
    if message.name in FINITE:
        lines += ["    finite: ClassVar[bool] = True", ""]
    first_extension = len(message.fields) if message.extensions_start is None else message.extensions_start
    for i, field in enumerate(message.fields):
        optional = i >= first_extension or field.name in OPTIONAL.get(message.name, ())
        lines += _field(field, optional=optional, own=message.name.startswith(OURS), enums=enums)
    return "\n".join(lines)


def _field(field: MAVField, *, optional: bool, own: bool, enums: set[str]) -> Iterator[str]:
    kind, zero = _python_type(field)
    if field.enum in enums and kind == "int":
        kind = f"int | {_class_name(field.enum)}"
    default = f" = {zero}" if optional else ""
    if field.const_value is not None:
        default = f" = {field.const_value}"
    yield f"    {field.name}: {kind}{default}"
    yield from _docstring(_about(field, own=own))


def _python_type(field: MAVField) -> tuple[str, str]:
    """The type of a field's value, and its zero."""
    length = field.array_length
    if field.type == "char":
        return "str", '""'
    if length and field.type == "uint8_t":
        return "bytes", f"bytes({length})"
    number = "float" if field.type in {"float", "double"} else "int"
    return (f"tuple[{number}, ...]", f"(0,) * {length}") if length else (number, "0")


def _about(field: MAVField, *, own: bool) -> str:
    """Shape, unit and invalid value of a field, and of our own messages the description."""
    said = field.description if own else ""
    parts: list[str] = []
    if field.type == "char" and field.array_length:
        parts.append(f"at most {field.array_length} bytes")
    elif field.array_length:
        parts.append(f"({field.array_length},)")
    if field.units and field.units not in said:
        parts.append(UNITS.get(field.units, field.units))
    invalid = field.invalid.strip("[],").replace("UINT16_MAX", "65535")
    if invalid and f"{invalid}:" not in said:
        parts.append(f"{invalid}: no value")
    return f"{said} {', '.join(parts)}".strip()


def _docstring(text: str) -> list[str]:
    """The lines of a docstring inside a class; the first sentence alone if it takes several lines."""
    text = " ".join(text.split())
    if not text:
        return []
    if len(text) + 10 <= WIDTH:
        return [f'    """{text}"""']
    first, _, rest = text.partition(". ")
    if rest and len(first) + 8 <= WIDTH:
        wrapped = textwrap.wrap(rest, WIDTH - 4)
        return [f'    """{first}.', "", *(f"    {line}" for line in wrapped), '    """']
    wrapped = textwrap.wrap(f'"""{text}', WIDTH - 4)
    return [*(f"    {line}" for line in wrapped), '    """']
