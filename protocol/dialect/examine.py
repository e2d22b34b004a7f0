"""Mistakes in a dialect that pymavlink's generator does not notice or does not explain.

It raises in four ways, prints, evaluates the values of enumerations as Python, writes modules that do not
compile, and packs messages that do not fit the wire. So a dialect's own files are examined first, also their
units: ground stations show them, and pymavlink's `mavgen --strict-units` refuses those that it does not know.
"""

from __future__ import annotations

import difflib
import functools
import keyword
import re
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from robotree.protocol.dialect.table import CODES, LARGEST_ID

if TYPE_CHECKING:
    from collections.abc import Iterator
    from xml.etree.ElementTree import Element

LARGEST_COMMAND = 2**16 - 1
"""COMMAND_LONG has 16 bits for it."""
MOST_FIELDS = 64
LARGEST_ARRAY = 255
_TYPE = re.compile(r"(\w+?)(?:_mavlink_version)?(?:\[(\d+)\])?")
_NUMBER = re.compile(r"[+-]?(?:\d+|0[xX][\da-fA-F]+|0b[01]+|\d+\*\*\d+)")


def problems(xml: Path) -> Iterator[str]:
    """The mistakes of one file, not of the files that it includes: a sentence for each, with its place."""
    try:
        root = ET.parse(xml).getroot()  # noqa: S314  a developer's own file; entities cost only him
    except ET.ParseError as error:
        yield f"it is no XML ({error})"
        return
    if root.tag != "mavlink":
        yield f"its root is <{root.tag}>, not <mavlink>"
    for enum in root.iter("enum"):
        yield from _in_enum(enum)
    for message in root.iter("message"):
        yield from _in_message(message)
    for element in root.iter():
        yield from _in_text(element)
        yield from _in_unit(element)


@functools.cache
def units() -> frozenset[str]:
    """The units that MAVLink knows, from the schema of the installed pymavlink."""
    import pymavlink

    schema = ET.parse(Path(str(pymavlink.__file__)).parent / "generator" / "mavschema.xsd")  # noqa: S314  its own
    space = "{http://www.w3.org/2001/XMLSchema}"
    kind = schema.find(f"{space}simpleType[@name='SI_Unit']")
    return (
        frozenset(each.get("value", "") for each in kind.iter(f"{space}enumeration"))
        if kind is not None
        else frozenset()
    )


def _in_enum(enum: Element) -> Iterator[str]:
    name = enum.get("name")
    if not name:
        yield "an enum has no name"
    for entry in enum.iter("entry"):
        said, value = entry.get("name") or "an entry without a name", entry.get("value")
        if value is None:
            continue  # the generator counts on
        if not _NUMBER.fullmatch(value):
            yield f"{said} of {name} has the value {value!r}, which is no number"
        elif name == "MAV_CMD" and _number(value) > LARGEST_COMMAND:
            yield f"the command {said} has the number {value}; the wire carries up to {LARGEST_COMMAND}"
        elif enum.get("bitmask") == "true" and (bits := _number(value)) & (bits - 1):
            yield f"{said} of the bitmask {name} has the value {value}, which is no power of two"


def _number(text: str) -> int:
    base, _, power = text.partition("**")
    return int(base, 0) ** int(power) if power else int(text, 0)


def _in_message(message: Element) -> Iterator[str]:
    name, number = message.get("name"), message.get("id") or ""
    if not name:
        yield f"the message with id {number or 'none'} has no name"
    if not number.isdecimal() or int(number) > LARGEST_ID:
        yield f"{name} has the id {number!r}, which is no number up to {LARGEST_ID}"
    fields = message.findall("field")
    if not 0 < len(fields) <= MOST_FIELDS:
        yield f"{name} has {len(fields)} fields; a message has 1 to {MOST_FIELDS}"
    seen: set[str] = set()
    for field in fields:
        yield from _in_field(f"{name}", field, seen)


def _in_field(message: str, field: Element, seen: set[str]) -> Iterator[str]:
    name, kind = field.get("name") or "", field.get("type") or ""
    if not name.isidentifier() or keyword.iskeyword(name) or name == "self":
        yield f"a field of {message} has the name {name!r}, which no program can use; choose another"
    if name in seen:
        yield f"{message} has two fields {name}"
    seen.add(name)
    found = _TYPE.fullmatch(kind)
    if found is None or found[1] not in CODES:
        yield f"{message}.{name} has the type {kind!r}; there are {', '.join(CODES)} and arrays of them"
    elif found[2] and not 0 < int(found[2]) <= LARGEST_ARRAY:
        yield f"{message}.{name} has {found[2]} elements; an array has 1 to {LARGEST_ARRAY}"


def _in_text(element: Element) -> Iterator[str]:
    text = (element.text or "").strip()
    if '"""' in text or text.endswith(('"', "\\")):
        shown = text if len(text) <= 40 else f"…{text[-40:]}"
        yield f"the text {shown!r} breaks what is generated; do without three quotes, and a quote at its end"


def _in_unit(element: Element) -> Iterator[str]:
    unit = element.get("units")
    if unit is not None and unit not in units():
        near = difflib.get_close_matches(unit, sorted(units()), 1, 0.4)
        way = f"is it {near[0]}?" if near else "write it in the text instead"
        said = element.get("name") or f"the parameter {element.get('label') or element.get('index')}"
        yield f"{said} has the unit {unit!r}, which MAVLink does not know; {way}"
