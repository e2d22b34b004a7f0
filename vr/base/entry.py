"""Entries of a space, and the templates that they match, as all processes know them. Pure.

An entry is a record of an author's own class, a dataclass or a `msgspec.Struct`. On its way, and in a store,
it is the names of its classes and its fields as plain values; `marks_of` makes of it a set of short texts. A
template is a part of such a set: an entry matches if it has all marks of the template. So every store decides
what equal means in the same way, and needs an index of texts only.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from hashlib import blake2b
from typing import Any, TypeVar, cast

import msgspec

from robotree.vr.base.errors import BadEntry, EntryUnfit
from robotree.vr.base.plain import plain_arguments

LARGEST_ENTRY = 256_000
"""[bytes] of one entry, packed."""
LONGEST_MARK = 64
"""Characters of a text that stand in a mark as they are; a longer text is represented by its hash."""
_KIND = ":"
"""The beginning of the mark of a class; no field has this name."""

_sorted = msgspec.msgpack.Encoder(order="deterministic").encode
_T = TypeVar("_T")


class Entry(msgspec.Struct, frozen=True):
    """A record in a space."""

    kinds: tuple[str, ...]
    """Names of its class and of the bases of that, the most special first."""
    fields: dict[str, Any]
    """Plain values by name."""

    @property
    def kind(self) -> str:
        """Name of its class."""
        return self.kinds[0]


def entry_of(record: object) -> Entry:
    """Return what a space keeps of a record.

    Args:
        record: of a dataclass or a Struct; its fields hold what commands may return (`to_plain`).

    Raises:
        BadEntry: it is no such record, or a field cannot travel.
    """
    cls = type(record)
    kinds = kinds_of(cls)
    if not kinds:
        reason = "it is neither a dataclass nor a msgspec.Struct; write a class for it with @dataclass"
        raise BadEntry(kind=cls.__name__, reason=reason)
    try:
        return Entry(kinds, plain_arguments(_values(record)))
    except TypeError as error:
        raise BadEntry(kind=kinds[0], reason=str(error)) from None


def template_of(wanted: object, fields: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the kind of a template, and the fields that are given in it.

    Args:
        wanted: a class, or a record of it, of which a field that is None may have any value.
        fields: values that must be equal; None: any.

    Raises:
        BadEntry: the class is none of an entry, has no such field, or a value cannot travel.
    """
    cls = cast("type[object]", wanted) if isinstance(wanted, type) else type(wanted)
    kinds = kinds_of(cls)
    if not kinds:
        reason = "only a dataclass or a msgspec.Struct can be asked for; name the class of the entries"
        raise BadEntry(kind=cls.__name__, reason=reason)
    known = names_of(cls)
    if unknown := [name for name in fields if name not in known]:
        reason = f"it has no field {unknown[0]!r}; it has: {', '.join(known) or 'none'}"
        raise BadEntry(kind=kinds[0], reason=reason)
    given = dict(fields) if isinstance(wanted, type) else {**_values(wanted), **fields}
    try:
        return kinds[0], plain_arguments({name: value for name, value in given.items() if value is not None})
    except TypeError as error:
        raise BadEntry(kind=kinds[0], reason=str(error)) from None


def revived(entry: Entry, wanted: type[_T]) -> _T:
    """Make a record of an entry.

    Args:
        entry: as a space keeps it.
        wanted: the class that was asked for. An entry of a more special class becomes one of that class, if
            this program has it under `wanted`, else one of `wanted`, without the fields that it lacks.

    Raises:
        EntryUnfit: the fields do not fit into the class.
    """
    cls = wanted if entry.kind == wanted.__name__ else _special(wanted, entry.kinds)
    known = names_of(cls)
    try:
        return msgspec.convert({n: v for n, v in entry.fields.items() if n in known}, cls)
    except (msgspec.ValidationError, TypeError, ValueError) as error:
        raise EntryUnfit(kind=entry.kind, reason=str(error)) from None


def kinds_of(cls: type[object]) -> tuple[str, ...]:
    """Return the names of a class and its bases, the most special first; empty: it is none of an entry."""
    return tuple(base.__name__ for base in cls.__mro__ if _is_record(base))


def names_of(cls: type[Any]) -> tuple[str, ...]:
    """Return the names of the fields of a class of entries."""
    if dataclasses.is_dataclass(cls):
        return tuple(field.name for field in dataclasses.fields(cls))
    return tuple(cls.__struct_fields__)


def marks_of(kinds: Iterable[str], fields: Mapping[str, Any]) -> frozenset[str]:
    """Return the marks of an entry, or those that a template asks for.

    Args:
        kinds: of an entry, all names of its classes; of a template, the one that is asked for, or none.
        fields: plain values; None has no mark, so that in a template it stands for any value.
    """
    marks = {_KIND + kind for kind in kinds}
    marks.update([f"{name}={_mark(value)}" for name, value in fields.items() if value is not None])
    return frozenset(marks)


def _mark(value: object) -> str:
    """Return a text that two values have in common if they are equal, and only then.

    Numbers are equal by value (1 and 1.0), truth values are no numbers.
    """
    kind = type(value)
    if kind is str:
        text = cast("str", value)
        if len(text) <= LONGEST_MARK and "\0" not in text:
            return f"s{text}"
        return f"h{blake2b(text.encode(), digest_size=16).hexdigest()}"
    if kind is bool:
        return "true" if value else "false"
    if kind is int or (kind is float and cast("float", value).is_integer()):
        number = int(cast("float", value))
        return f"n{number}"
    if kind is float:
        return f"n{value!r}"
    return f"x{blake2b(_sorted(_equal(value)), digest_size=16).hexdigest()}"


def _equal(value: Any) -> Any:
    """Return a value in which equal numbers are the same."""
    if isinstance(value, list | tuple):
        return [_equal(part) for part in cast("list[Any]", value)]
    if isinstance(value, dict):
        return {name: _equal(part) for name, part in cast("dict[str, Any]", value).items()}
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _is_record(cls: type[object]) -> bool:
    return cls is not msgspec.Struct and (issubclass(cls, msgspec.Struct) or dataclasses.is_dataclass(cls))


def _values(record: object) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names_of(type(record))}


def _special(wanted: type[_T], kinds: tuple[str, ...]) -> type[_T]:
    """Return the most special class under one that has one of these names."""
    known: dict[str, type[_T]] = {}
    left = [wanted]
    while left:
        cls = left.pop()
        known[cls.__name__] = cls
        left += cls.__subclasses__()
    return next((known[kind] for kind in kinds if kind in known), wanted)
