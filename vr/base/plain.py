"""Values on their way: what an author's code hands over becomes numbers, texts, lists and mappings.

Numbers and arrays of numpy are known by their `tolist`, so that numpy is not imported here. Pure.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from enum import Enum
from typing import Any, cast

import msgspec

LARGEST_BYTES = 256_000
"""[bytes] of one picture in a result."""
DEEPEST = 32
"""Levels of lists and records in each other."""
_PLAIN = frozenset({type(None), bool, int, float, str})
READY = _PLAIN - {int}
"""Types of values that travel as they are: nothing about them has to be looked at."""
_WHOLE = range(-(2**63), 2**64)
"""Whole numbers that MessagePack can carry."""


def to_plain(value: Any) -> Any:
    """Return a value as plain ones.

    Args:
        value: None, number, text, Enum of these, bytes; a list, tuple or set; a mapping with texts as keys,
            dataclass or Struct; a number or an array of numpy.

    Returns:
        The same of None, bool, int, float, str, bytes, list and dict alone.

    Raises:
        TypeError: it cannot travel.
    """
    return _plain(value, 0)


def plain_arguments(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments by name as plain values.

    Raises:
        TypeError: one cannot travel; names it.
    """
    plain = dict(arguments)
    for name, value in plain.items():
        if type(value) not in READY:
            try:
                plain[name] = _plain(value, 0)
            except TypeError as error:
                raise TypeError(f"{name}: {error}") from None
    return plain


def _plain(value: Any, depth: int) -> Any:
    if type(value) in _PLAIN:
        if type(value) is int and value not in _WHOLE:
            raise TypeError("cannot travel: a whole number has 64 bits at most")
        return value
    if depth >= DEEPEST:
        raise TypeError(f"cannot travel: more than {DEEPEST} levels of lists or records")
    if isinstance(value, Enum):
        return _plain(value.value, depth + 1)
    if isinstance(value, Mapping):
        return _mapping(cast("dict[Any, Any]", value), depth)
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(part, depth + 1) for part in cast("list[Any]", value)]
    if isinstance(value, bytes | bytearray | memoryview):
        return _bytes(bytes(cast("bytes", value)))
    return _other(value, depth)


def _mapping(value: Mapping[Any, Any], depth: int) -> dict[str, Any]:
    for key in value:
        if not isinstance(key, str):
            raise TypeError(f"cannot travel: the key {key!r} of a mapping is no text")
    return {str(key): _plain(part, depth + 1) for key, part in value.items()}


def _bytes(value: bytes) -> bytes:
    if len(value) > LARGEST_BYTES:
        reason = f"{len(value)} bytes are more than {LARGEST_BYTES}"
        raise TypeError(f"cannot travel: {reason}; make the picture smaller, or its quality lower")
    return value


def _other(value: Any, depth: int) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return _mapping(parts, depth)
    if isinstance(value, msgspec.Struct):
        return _mapping(msgspec.structs.asdict(value), depth)
    listed = getattr(value, "tolist", None) or getattr(value, "item", None)  # of numpy
    if callable(listed) and not isinstance(value, type):
        return _plain(listed(), depth + 1)
    for base in (int, float, str):
        if isinstance(value, base):  # of a class derived from it
            return base(value)
    try:
        return msgspec.to_builtins(value)  # times, unique ids, decimals
    except TypeError:
        kind = type(value).__name__
        raise TypeError(
            f"cannot travel: {kind} is neither number, text, list, dictionary, dataclass nor Struct"
        ) from None
