"""The table of all messages of the dialect: what a codec must know, and nothing else.

`table.json` is generated from robotree.xml and the base files of the installed pymavlink
(`python -m robotree.protocol.dialect`); a test regenerates and compares. Loading it takes a fraction of the
time that a generated module takes to import.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import msgspec

TABLE = Path(__file__).with_name("table.json")
CODES = {
    "float": "f",
    "double": "d",
    "char": "c",
    "int8_t": "b",
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
}

LARGEST_ID = 2**24 - 1
"""Of a message: the wire has three bytes for it."""
FIRST_OWN_ID = 10_000_000
"""Ids from here on are for robots of somebody's own: robotree never gives them, nor has MAVLink so far."""

SECRETS = {"SETUP_SIGNING": frozenset({"secret_key"})}
"""Fields whose values are never shown, logged, recorded or passed on, by the name of their message."""


class Field(msgspec.Struct, frozen=True, array_like=True):
    """One field of a message. Fields of a message are listed in the order of the XML."""

    name: str
    type: str
    """The XML's: float, double, char, int8_t … uint64_t."""
    length: int
    """Elements of an array; 0 for a single value."""
    offset: int
    """Where it begins in the payload, [bytes]."""

    @property
    def is_bytes(self) -> bool:
        """Whether its array is one value of type bytes (or str) instead of a tuple."""
        return self.length > 0 and self.type in ("char", "uint8_t")

    @property
    def code(self) -> str:
        """Of the field, for `struct`.

        Raises:
            KeyError: the type is none of MAVLink's.
        """
        if self.is_bytes:
            return f"{self.length}s"
        return f"{self.length or ''}{CODES[self.type]}"


class Definition(msgspec.Struct, frozen=True):
    """One message of the dialect."""

    id: int
    name: str
    crc_extra: int
    length: int
    """Full length of the payload, [bytes]."""
    minimum: int
    """Length of the payload without extensions, [bytes]; all that MAVLink 1 carries."""
    format: str
    """Of the payload, for `struct`; char and uint8_t arrays are single values of type bytes."""
    fields: tuple[Field, ...]
    target_system: int
    """Offset of the field of that name in the payload; -1: none."""
    target_component: int
    """Offset of the field of that name in the payload; -1: none."""

    @property
    def secrets(self) -> frozenset[str]:
        """The fields whose values must not be shown; see `SECRETS`."""
        return SECRETS.get(self.name, frozenset())


@cache
def definitions() -> dict[int, Definition]:
    """All messages of the dialect, by id."""
    listed = msgspec.json.decode(TABLE.read_bytes(), type=list[Definition])
    return {each.id: each for each in listed}


@cache
def by_name() -> dict[str, Definition]:
    """All messages of the dialect, by name."""
    return {each.name: each for each in definitions().values()}
