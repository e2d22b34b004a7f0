"""One message between Python values and payload bytes, precompiled from its definition.

The same values occur in three shapes:

* declared: one value per field in the order of the XML; text is `str`, a uint8_t array is `bytes`;
* flat: what `struct` wants, in wire order, numeric arrays laid open;
* bytes: the frame from its length byte to the end of its payload. Header and payload are one `struct`.
"""

from __future__ import annotations

import struct
from itertools import accumulate
from math import isfinite
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any

from msgspec.structs import astuple

from robotree.protocol.errors import InvalidMessage

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from robotree.protocol.dialect.table import Definition, Field
    from robotree.protocol.messages.base import Message

Value = int | float | str | bytes | tuple[int, ...] | tuple[float, ...]
Values = tuple[Any, ...]

HEADER = "<BBBBBBHB"
"""Length, incompatibility flags, compatibility flags, sequence, system, component, id (low, high)."""
HEADER_VALUES = 8
HEADER_BYTES = 9
PACKING_ERRORS = (struct.error, OverflowError, TypeError)
"""What `struct` raises for a value that does not fit."""
_FLOATS = ("float", "double")


class Codec:
    """The precompiled form of one definition."""

    __slots__ = (
        "build",
        "crc_extra",
        "declare",
        "definition",
        "flatten",
        "flatten_declared",
        "floats",
        "id_high",
        "id_low",
        "length",
        "pack",
        "size",
        "unpack",
        "wire",
    )

    def __init__(self, definition: Definition, build: Callable[..., Any]) -> None:
        self.definition = definition
        self.build = build
        """From declared values to the message."""
        self.id_low, self.id_high = definition.id & 0xFFFF, definition.id >> 16
        self.crc_extra = bytes((definition.crc_extra,))
        self.length = definition.length
        packer = struct.Struct(HEADER + definition.format[1:])
        self.size, self.pack, self.unpack = packer.size, packer.pack, packer.unpack_from
        self.wire = tuple(sorted(definition.fields, key=lambda field: field.offset))
        names = [field.name for field in definition.fields]
        order = [field.name for field in self.wire]
        self.declare = _declarer(definition, _spans(self.wire, HEADER_VALUES))
        """From what `unpack` gives, header included, to declared values."""
        self.flatten = _flattener(definition, _getter(attrgetter, order, astuple if order == names else None))
        """From a typed message to flat values."""
        self.flatten_declared = _flattener(definition, _getter(itemgetter, [*map(names.index, order)]))
        """From declared values to flat values."""
        self.floats = _floats(self.wire)
        """From flat values to those of floating-point fields."""

    def content(self, message: Message) -> bytes:
        """The full payload of a message, zeros at its end included; equal when every bit is.

        Raises:
            InvalidMessage: a field cannot hold its value.
        """
        flat = self.flatten(message)
        try:
            return bytes(self.pack(*bytes(HEADER_VALUES), *flat)[HEADER_BYTES:])
        except PACKING_ERRORS as error:
            raise self.diagnose(flat) from error

    def require_finite(self, flat: Values) -> None:
        """Refuse NaN and infinity in any floating-point field.

        Raises:
            InvalidMessage: naming the first such field.
        """
        for field, span in zip(self.wire, _spans(self.wire), strict=True):
            if field.type in _FLOATS and not all(map(isfinite, flat[span])):
                raise InvalidMessage(self.definition.name, field.name, "must be finite")

    def diagnose(self, flat: Values) -> InvalidMessage:
        """Which field made `struct` refuse the flat values."""
        for field, span in zip(self.wire, _spans(self.wire), strict=True):
            values = flat[span]
            try:
                struct.pack("<" + field.code, *values)
            except PACKING_ERRORS as error:
                shown = values[0] if len(values) == 1 else values
                return InvalidMessage(self.definition.name, field.name, f"cannot hold {shown!r} ({error})")
        return InvalidMessage(self.definition.name, "*", f"got {len(flat)} values")


def _spans(wire: Sequence[Field], start: int = 0) -> list[slice]:
    """Where the values of each field, in wire order, lie among flat values."""
    counts = [1 if field.is_bytes else max(field.length, 1) for field in wire]
    ends = list(accumulate(counts, initial=start))
    return [slice(end - count, end) for count, end in zip(counts, ends[1:], strict=True)]


def _floats(wire: Sequence[Field]) -> Callable[[Values], Values]:
    """Floating-point fields lie side by side, but for an integer of their size among them."""
    spans = [span for field, span in zip(wire, _spans(wire), strict=True) if field.type in _FLOATS]
    if not spans:
        return itemgetter(slice(0))
    if sum(span.stop - span.start for span in spans) == spans[-1].stop - spans[0].start:
        return itemgetter(slice(spans[0].start, spans[-1].stop))
    return itemgetter(*(i for span in spans for i in range(span.start, span.stop)))


def _declarer(definition: Definition, spans: list[slice]) -> Callable[[Values], Values]:
    """From unpacked to declared values, by one C call where there is no text."""
    wire = sorted(definition.fields, key=lambda field: field.offset)
    place: dict[str, Any] = {
        field.name: span if field.length and not field.is_bytes else span.start
        for field, span in zip(wire, spans, strict=True)
    }
    keys = [place[field.name] for field in definition.fields]
    pick: Callable[[Values], Any] = itemgetter(*keys)
    if keys == list(range(HEADER_VALUES, HEADER_VALUES + len(keys))):
        pick = itemgetter(slice(HEADER_VALUES, None))
    elif len(keys) == 1:  # itemgetter hands a single item out bare
        pick = _wrapped(pick)
    texts = [i for i, field in enumerate(definition.fields) if field.type == "char"]
    if not texts:
        return pick

    def declare(unpacked: Values) -> Values:
        values = list(pick(unpacked))
        for i in texts:
            values[i] = values[i].split(b"\0", 1)[0].decode("utf-8", "replace")
        return tuple(values)

    return declare


def _wrapped(get: Callable[[Any], Any]) -> Callable[[Any], Values]:
    return lambda source: (get(source),)


def _getter(
    kind: Callable[..., Callable[[Any], Any]],
    keys: list[Any],
    shortcut: Callable[[Any], Values] | None = None,
) -> Callable[[Any], Values]:
    """A function that takes the fields from an object, in wire order."""
    if shortcut is not None:
        return shortcut
    return kind(*keys) if len(keys) > 1 else _wrapped(kind(*keys))


def _flattener(definition: Definition, get: Callable[[Any], Values]) -> Callable[[Any], Values]:
    """From an object to flat values; `get` takes the fields from it in wire order."""
    wire = sorted(definition.fields, key=lambda field: field.offset)
    openers = [(i, _opener(definition.name, field)) for i, field in enumerate(wire) if field.length]
    openers.reverse()
    if not openers:
        return get
    if len(openers) == 1:
        i, opener = openers[0]

        def flatten_one(source: Any) -> Values:
            values = get(source)
            return values[:i] + opener(values[i]) + values[i + 1 :]

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
        data = value.encode() if isinstance(value, str) else bytes(value)
        if len(data) > length:
            raise InvalidMessage(name, field.name, f"holds {length} bytes, not {len(data)}")
        return (data,)

    def open_numbers(value: Sequence[float]) -> Values:
        if len(value) != length:
            raise InvalidMessage(name, field.name, f"holds exactly {length} numbers, not {len(value)}")
        return tuple(value)

    return open_bytes if field.is_bytes else open_numbers
