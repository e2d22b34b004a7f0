"""From XML to the table, and to other languages.

The base files (common.xml and what it includes) come from the installed pymavlink at generation time and are
not part of this project. pymavlink's own generator is the compiler of every language and the oracle of the
tests; it reports failure in four different ways and prints on the way, so it is run behind `generate`.

It also evaluates the values of enumerations as Python, writes modules that do not compile, and packs messages
that do not fit the wire. So a dialect's own files are examined first, also their units: ground stations show
them, and pymavlink's `mavgen --strict-units` refuses those that it does not know.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import io
import keyword
import re
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import msgspec

from robotree.files import read
from robotree.protocol.dialect.errors import NotWritten, UnknownBase, writing
from robotree.protocol.dialect.table import CODES, LARGEST_ID, Definition, Field
from robotree.protocol.errors import DialectError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator
    from xml.etree.ElementTree import Element

    from pymavlink.generator.mavparse import MAVXML, MAVType

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


DIALECT = Path(__file__).with_name("robotree_full.xml")
SUBSET = "upstream_subset.xml"
"""The parts of upstream's dialects that we use and pymavlink's `common` lacks; another base may have them."""
LARGEST_PAYLOAD = 255
LARGEST_NESTING = 8
LARGEST = 4_000_000
"""[bytes] of one XML; MAVLink's largest has 0.5 MB."""


def base_directory() -> Path:
    """Where the installed pymavlink keeps the XML of the base dialects."""
    import pymavlink

    return Path(str(pymavlink.__file__)).parent / "dialects" / "v20"


@contextlib.contextmanager
def workspace(xml: Path) -> Generator[Path]:
    """A temporary folder with `xml`, its neighbours, our files and the base's, since includes are relative.

    Yields:
        The copy of `xml`.

    Raises:
        DialectError: there is no `xml`, or it cannot be read.
        NotWritten: the temporary folder has no room.
    """
    try:
        read(xml, LARGEST)
    except FileNotFoundError:
        raise DialectError(str(xml), "there is no such file") from None
    except OSError as error:
        raise DialectError(str(xml), f"it cannot be read: {error.strerror}") from error
    with tempfile.TemporaryDirectory(prefix="robotree-dialect-") as name:
        folder = Path(name)
        for source in (base_directory(), DIALECT.parent, xml.parent):  # the nearest file of a name is taken
            for each in source.glob("*.xml"):
                with contextlib.suppress(OSError):  # no ordinary file: it is missed only where it is included
                    content = read(each, LARGEST)
                    with writing(folder):
                        (folder / each.name).write_bytes(content)
        yield folder / xml.name


@contextlib.contextmanager
def beside(base: str, xml: Path = DIALECT) -> Generator[Path]:
    """A dialect that has all that `xml` has and all of one of the base dialects, for a tool that wants both.

    Args:
        base: such as `ardupilotmega`; empty: nothing more.
        xml: the dialect.

    Yields:
        Its XML, in a temporary folder.

    Raises:
        DialectError: `xml` is wrong, or has an id or a name that the base dialect uses for something else.
        UnknownBase: pymavlink brings no such dialect.
    """
    if not base:
        yield xml
        return
    offered = sorted(path.stem for path in base_directory().glob("*.xml"))
    if base not in offered:
        raise UnknownBase(base, tuple(offered))
    build(xml)  # so that its own mistakes are told by its own name
    with workspace(xml) as copy:
        both = copy.with_name(f"{xml.stem}_{base}.xml")
        includes = "".join(f"<include>{name}</include>" for name in (f"{base}.xml", copy.name))
        with writing(both):
            _leave_out(copy.with_name(SUBSET), parse(base_directory() / f"{base}.xml"))
            both.write_text(f"<mavlink>{includes}<messages/></mavlink>", encoding="utf-8")
        try:
            yield both
        except DialectError as error:
            raise DialectError(str(xml), f"it does not go with {base}: {error.detail}") from error


def _leave_out(copy: Path, base: list[MAVXML]) -> None:
    """Take out of a copy of our part of upstream what a base dialect has, too."""
    messages = {message.name for file in base for message in file.message}
    entries = {entry.name for file in base for enum in file.enum for entry in enum.entry}
    tree = ET.parse(copy)  # noqa: S314  our own file
    for parent in [*tree.iterfind("messages"), *tree.iterfind("enums"), *tree.iterfind("enums/enum")]:
        for each in list(parent):
            theirs = messages if each.tag == "message" else entries
            names = [each] if each.tag == "message" else each.iter("entry")
            if each.tag != "description" and all(name.get("name") in theirs for name in names):
                parent.remove(each)
    tree.write(copy)


def parse(xml: Path = DIALECT) -> list[MAVXML]:
    """Read a dialect with everything it includes.

    Raises:
        DialectError: the XML is wrong; the error has what pymavlink found.
    """
    from pymavlink.generator import mavparse

    def include_in(seen: dict[Path, MAVXML], path: Path, depth: int = 0) -> None:
        if path in seen:
            return
        if depth > LARGEST_NESTING:
            raise DialectError(str(xml), f"includes are nested deeper than {LARGEST_NESTING}")
        if not path.is_file():
            raise DialectError(
                str(xml), f"it includes {path.name}, which lies neither beside it nor in robotree nor MAVLink"
            )
        if not (base_directory() / path.name).exists() and (problem := next(problems(path), None)):
            raise DialectError(str(xml.with_name(path.name)), problem)
        parsed = seen[path] = mavparse.MAVXML(str(path), mavparse.PROTOCOL_2_0)
        for include in parsed.include:
            include_in(seen, path.parent / include, depth + 1)

    said, seen = io.StringIO(), dict[Path, "MAVXML"]()
    with workspace(xml) as copy, contextlib.redirect_stdout(said):
        try:
            include_in(seen, copy)
            every = list(seen.values())
            wrong = mavparse.check_duplicates(every) or mavparse.check_missing_enum(every)
        except DialectError:
            raise
        except Exception as error:  # whatever the parser may raise
            raise DialectError(str(xml), _told(error, copy.parent)) from error
    if wrong:
        raise DialectError(str(xml), _complaint(said.getvalue(), copy.parent))
    return every


def checked(xml: Path = DIALECT) -> list[MAVXML]:
    """Read a dialect with everything it includes, for a generator.

    Raises:
        DialectError: the XML is wrong, or a message is too long for the wire.
    """
    parsed = parse(xml)
    table_of(parsed, xml)
    return parsed


def build(xml: Path = DIALECT) -> list[Definition]:
    """The table of a dialect, by id.

    Raises:
        DialectError: the XML is wrong, or a message is too long for the wire.
    """
    return table_of(parse(xml), xml)


def table_of(parsed: list[MAVXML], xml: Path = DIALECT) -> list[Definition]:
    """The table of a dialect that was parsed, by id.

    Raises:
        DialectError: a message is too long for the wire.
    """
    messages = (message for file in parsed for message in file.message)
    table = sorted((_definition(message) for message in messages), key=lambda each: each.id)
    for each in table:
        if each.length > LARGEST_PAYLOAD:
            problem = f"{each.name} has {each.length} bytes, the wire carries {LARGEST_PAYLOAD}"
            raise DialectError(str(xml), problem)
    return table


def _definition(message: MAVType) -> Definition:
    fields = tuple(
        Field(field.name, field.type, field.array_length, field.wire_offset) for field in message.fields
    )
    offsets = {field.name: field.offset for field in fields}
    return Definition(
        id=message.id,
        name=message.name,
        crc_extra=message.crc_extra,
        length=message.wire_length,
        minimum=message.wire_min_length,
        format="<" + "".join(field.code for field in sorted(fields, key=lambda each: each.offset)),
        fields=fields,
        target_system=offsets.get("target_system", -1),
        target_component=offsets.get("target_component", -1),
    )


def dump(table: list[Definition]) -> bytes:
    """The bytes of table.json: one message per line, so that a change reads well in a diff."""
    lines = b",\n".join(msgspec.json.encode(each) for each in table)
    return b"[\n" + lines + b"\n]\n"


def generate(output: Path, *, xml: Path = DIALECT, language: str = "Python3") -> None:
    """Run pymavlink's generator.

    Args:
        output: the file to write, or the folder for languages that need several.
        xml: the dialect.
        language: one of `languages()`.

    Raises:
        DialectError: the generator failed, whichever way it chose to say so.
        NotWritten: it was the system that failed.
    """
    from pymavlink.generator import mavgen

    parsed = checked(xml)
    said, failure, done = io.StringIO(), "", False
    with workspace(xml) as copy, contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        options = mavgen.Opts(
            str(output.absolute()), wire_protocol="2.0", language=language, validate=True, strict_units=True
        )
        for each in parsed:
            _complete(copy.with_name(Path(each.filename).name))
        try:
            with writing(output):
                done = mavgen.mavgen(options, [str(copy)]) is True
        except NotWritten:
            raise
        except (Exception, SystemExit) as error:  # noqa: BLE001  it raises what it likes, SystemExit included
            failure = _told(error, copy.parent)
    if not done:
        raise DialectError(str(xml), failure or _complaint(said.getvalue(), copy.parent))


def _complete(copy: Path) -> None:
    """Give an XML that only includes others the empty list of messages that the generator's schema wants."""
    tree = ET.parse(copy)  # noqa: S314  a developer's own file; entities cost only him
    if tree.find("messages") is None:
        ET.SubElement(tree.getroot(), "messages")
        tree.write(copy)


def _told(error: BaseException, folder: Path) -> str:
    """Return the text of an error; its frames are cleared, since mavparse leaves files open in them."""
    with warnings.catch_warnings(action="ignore", category=ResourceWarning):
        traceback.clear_frames(error.__traceback__)
    return _line(str(error) or type(error).__name__, folder)


def _complaint(said: str, folder: Path) -> str:
    """Return the generator's output from the first error on; the lines before it are notes."""
    lines = said.strip().splitlines()
    first = next((i for i, line in enumerate(lines) if line.startswith("ERROR")), len(lines) - 1)
    return _line(" ".join(lines[max(first, 0) :]), folder)


def _line(text: str, folder: Path) -> str:
    """One line, without our temporary folder and the codes of the schema's validator."""
    text = re.sub(r"^ERROR: |\S*:SCHEMASV:\w+: ", "", text.replace(f"{folder}/", ""))
    return " ".join(text.split())


def languages() -> tuple[str, ...]:
    """The languages that pymavlink can generate."""
    from pymavlink.generator import mavgen

    return tuple(mavgen.supportedLanguages)
