"""Messages as plain data, for JSON and for people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robotree.protocol.messages import fields_of

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame


HIDDEN = "<hidden>"
"""What stands for a secret."""


def plain_fields(frame: Frame) -> dict[str, Any]:
    """The fields of a frame's message; uint8_t arrays become lists of numbers, and secrets are hidden.

    NaN and infinity stay: msgspec writes them as null, since JSON has neither.
    """
    fields, secrets = fields_of(frame.message), frame.codec.definition.secrets
    plain = {name: [*value] if isinstance(value, bytes) else value for name, value in fields.items()}
    return plain | dict.fromkeys(secrets, HIDDEN)
