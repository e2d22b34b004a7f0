"""A page's own exception class, as its name crosses from one robot to another."""

from __future__ import annotations

from typing import Any

import msgspec


class OwnClass(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The class of an error that a page has defined. See `running/own_errors.py`."""

    name: str
    digest: str
    """SHA-256, in hex, of the text of the file that defines the class."""
    arguments: tuple[Any, ...] = ()
    """`args` of the error, as plain values."""
    values: dict[str, Any] = {}
    """The attributes of the error, as plain values."""
