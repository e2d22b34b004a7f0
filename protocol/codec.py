"""One message between Python values and payload bytes, precompiled from its definition.

The same values occur in three shapes:

* declared: one value per field in the order of the XML; text is `str`, a uint8_t array is `bytes`;
* flat: what `struct` wants, in wire order, numeric arrays laid open;
* bytes: the payload; `pack` writes the header before it, because one call of `struct` is cheaper than two.

Everything that depends on the definition alone is decided once, in here, and not again for every frame.
"""

from __future__ import annotations

import codecs
import struct
from itertools import accumulate
from math import isfinite
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec.structs import astuple

from robotree.protocol.errors import InvalidMessage

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from robotree.protocol.dialect.table import Definition, Field

Value = int | float | str | bytes | tuple[int, ...] | tuple[float, ...]
Values = tuple[Any, ...]

AS_LONG = "robotree.as_long"
"""How bytes that are no UTF-8 are decoded: as one `?` each, so that no text becomes longer than its field."""


def _as_long(error: UnicodeError) -> tuple[str, int]:
    """Stand in for the bytes that cannot be decoded."""
    if not isinstance(error, UnicodeDecodeError):
        raise error
    return "?" * (error.end - error.start), error.end


codecs.register_error(AS_LONG, _as_long)

HEADER = struct.Struct("<4sBBB3s")
"""The fields that a definition decides (magic, length, flags, flags), sequence, system, component, id."""
MAGIC = 0xFD
SIGNED = 0x01
"""The only incompatibility flag there is."""
PACKING_ERRORS = (struct.error, OverflowError, TypeError)
"""Errors of `struct` for a value that does not fit."""
_FLOATS = ("float", "double")


class Codec:
    """The precompiled form of one definition."""

    __slots__ = (
        "build",
        "crc_extra",
        "definition",
        "finite",
        "flatten",
        "flatten_declared",
        "id",
        "length",
        "pack",
        "read",
        "start",
        "start_signed",
        "wire",
    )

    def __init__(self, definition: Definition, build: Callable[..., Any], *, finite: bool = False) -> None:
        self.definition = definition
        self.makes(build, finite=finite)
        self.id = definition.id.to_bytes(3, "little")
        self.crc_extra = bytes((definition.crc_extra,))
        self.length = definition.length
        self.start = bytes((MAGIC, definition.length, 0, 0))
        """The first bytes of a frame with the full payload."""
        self.start_signed = bytes((MAGIC, definition.length, SIGNED, 0))
        """The same, of one that will be signed."""
        self.pack = struct.Struct(HEADER.format + definition.format[1:]).pack
        """From the values of the header and flat values to bytes."""
        self.wire = tuple(sorted(definition.fields, key=lambda field: field.offset))
        names = [field.name for field in definition.fields]
        order = [field.name for field in self.wire]
        self.flatten = _flattener(definition, astuple if order == names else _wrapped(attrgetter, order))
        """From a typed message to flat values."""
        places = [names.index(name) for name in order]
        self.flatten_declared = _flattener(
            definition, tuple if order == names else _wrapped(itemgetter, places)
        )
        """From declared values to flat values."""

    def makes(self, build: Callable[..., Any], *, finite: bool) -> None:
        """Have messages made by `build` from now on: the class may come after the first frame."""
        self.build = build
        """From declared values to the message."""
        self.finite = finite
        """Whether NaN and infinity are refused when it is sent."""
        self.read = _reader(self.definition, build)
        """From bytes and the place of the payload, which goes to their end, to the message."""

    def content(self, message: msgspec.Struct) -> bytes:
        """The full payload of a message, zeros at its end included; equal when every bit is.

        Raises:
            InvalidMessage: a field cannot hold its value.
        """
        flat = self.flatten(message)
        try:
            return struct.pack(self.definition.format, *flat)
        except PACKING_ERRORS as error:
            raise self.diagnose(flat) from error

    def require_finite(self, flat: Sequence[Any]) -> None:
        """Refuse NaN and infinity in any floating-point field.

        Raises:
            InvalidMessage: naming the first such field.
        """
        for field, span in zip(self.wire, _spans(self.wire), strict=True):
            if field.type in _FLOATS and not all(map(isfinite, flat[span])):
                raise InvalidMessage(self.definition.name, field.name, "must be finite")

    def diagnose(self, flat: Sequence[Any]) -> InvalidMessage:
        """Which field made `struct` refuse the flat values."""
        needed = _spans(self.wire)[-1].stop
        if len(flat) != needed:
            return InvalidMessage(self.definition.name, "*", f"needs {needed} values, not {len(flat)}")
        for field, span in zip(self.wire, _spans(self.wire), strict=True):
            values = flat[span]
            try:
                struct.pack("<" + field.code, *values)
            except PACKING_ERRORS as error:
                shown = values[0] if len(values) == 1 else values
                return InvalidMessage(self.definition.name, field.name, f"cannot hold {shown!r} ({error})")
        return InvalidMessage(self.definition.name, "*", "needs a system and component from 0 to 255")


def _spans(wire: Sequence[Field]) -> list[slice]:
    """Where the values of each field, in wire order, lie among flat values."""
    counts = [1 if field.is_bytes else max(field.length, 1) for field in wire]
    ends = list(accumulate(counts, initial=0))
    return [slice(end - count, end) for count, end in zip(counts, ends[1:], strict=True)]


def _reader(definition: Definition, build: Callable[..., Any]) -> Callable[[bytes, int], Any]:
    """From payload to message; a payload that is shorter than we know it had zeros or extensions left out."""
    unpack, length = struct.Struct(definition.format).unpack_from, definition.length
    declare = _declarer(definition)
    if declare is None:

        def read_plain(data: bytes, begin: int) -> Any:
            if len(data) - begin < length:
                data = data.ljust(begin + length, b"\0")
            return build(*unpack(data, begin))

        return read_plain

    def read(data: bytes, begin: int) -> Any:
        if len(data) - begin < length:
            data = data.ljust(begin + length, b"\0")
        return build(*declare(unpack(data, begin)))

    return read


def _declarer(definition: Definition) -> Callable[[Values], Values] | None:
    """From unpacked to declared values, by one C call where there is no text; None: they are the same."""
    wire = sorted(definition.fields, key=lambda field: field.offset)
    place: dict[str, Any] = {
        field.name: span if field.length and not field.is_bytes else span.start
        for field, span in zip(wire, _spans(wire), strict=True)
    }
    keys = [place[field.name] for field in definition.fields]
    whole = keys == list(range(len(keys)))
    texts = [i for i, field in enumerate(definition.fields) if field.type == "char"]
    if whole and not texts:
        return None
    pick: Callable[[Values], Values] = tuple if whole else _wrapped(itemgetter, keys)
    if not texts:
        return pick

    def declare(unpacked: Values) -> Values:
        values: list[Any] = [*pick(unpacked)]
        for i in texts:
            values[i] = values[i].split(b"\0", 1)[0].decode("utf-8", AS_LONG)
        return tuple(values)

    return declare


def _wrapped(getter: Callable[..., Callable[[Any], Any]], keys: list[Any]) -> Callable[[Any], Values]:
    """`getter(*keys)`, but always of a tuple: the operator module's getters hand a single item out bare."""
    get = getter(*keys)
    return get if len(keys) > 1 else lambda source: (get(source),)


def _flattener(definition: Definition, get: Callable[[Any], Values]) -> Callable[[Any], Values]:
    """From an object to flat values; `get` takes the fields from it in wire order."""
    wire = sorted(definition.fields, key=lambda field: field.offset)
    openers = [(i, _opener(definition.name, field)) for i, field in enumerate(wire) if field.length]
    openers.reverse()
    if not openers:
        return get
    if len(openers) == 1:
        i, opener = openers[0]
        behind = i + 1

        def flatten_one(source: Any) -> Values:
            values = get(source)
            return values[:i] + opener(values[i]) + values[behind:]

        return flatten_one

    def flatten(source: Any) -> Values:
        values = get(source)
        for i, opener in openers:
            values = values[:i] + opener(values[i]) + values[i + 1 :]
        return values

    return flatten


def _opener(name: str, field: Field) -> Callable[[Any], Values]:
    """Lay one array open and check its length. The wire pads text and bytes with zeros, never numbers."""
    length = field.length

    def open_bytes(value: str | bytes) -> Values:
        data = value.encode() if isinstance(value, str) else b"".join((value,))
        if len(data) > length:
            raise InvalidMessage(name, field.name, f"holds {length} bytes, not {len(data)}")
        return (data,)

    def open_numbers(value: Sequence[float]) -> Values:
        if len(value) != length:
            raise InvalidMessage(name, field.name, f"holds exactly {length} numbers, not {len(value)}")
        return tuple(value)

    return open_bytes if field.is_bytes else open_numbers
