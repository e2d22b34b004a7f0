"""What all messages have in common, and the one registry of them.

A message that robotree speaks is a class below `Message`, decorated with its name on the wire; its fields are
the XML's, in the XML's order, which a test compares. Every other message of the dialect is an `Untyped`.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import msgspec

from robotree.protocol.codec import Codec
from robotree.protocol.dialect.table import by_name, definitions
from robotree.protocol.errors import InvalidMessage, UnknownMessage

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.protocol.codec import Value
    from robotree.protocol.dialect.table import Definition


class Message(msgspec.Struct, frozen=True, gc=False):
    """A typed message. Immutable; equal when type and values are."""

    codec: ClassVar[Codec]
    finite: ClassVar[bool] = False
    """Whether NaN and infinity are forbidden when we send it. Only for messages of nothing but numbers."""


class Untyped(msgspec.Struct, frozen=True, gc=False):
    """A message of the dialect for which there is no class: its values in the order of the XML."""

    msgid: int
    values: tuple[Any, ...]

    finite: ClassVar[bool] = False

    @property
    def codec(self) -> Codec:
        """Its precompiled form.

        Raises:
            UnknownMessage: the dialect has no message of this id.
        """
        return codec_of(self.msgid)

    def __getitem__(self, field: str) -> Value:
        """The value of a field by its name."""
        return fields_of(self)[field]

    def __repr__(self) -> str:
        return f"Untyped(msgid={self.msgid}, values={self._shown()!r})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        return [("msgid", self.msgid), ("values", self._shown())]

    def _shown(self) -> Any:
        """The values, if none of them is secret."""
        definition = definitions().get(self.msgid)
        return ... if definition is not None and definition.secrets else self.values


AnyMessage = Message | Untyped
M = TypeVar("M", bound=Message)

TYPED: dict[int, type[Message]] = {}
"""Every message that has a class, by id. Filled by `wire`."""


def wire(name: str) -> Callable[[type[M]], type[M]]:
    """Class decorator: this class is the message `name` of the dialect."""

    def register(cls: type[M]) -> type[M]:
        definition = by_name()[name]
        TYPED[definition.id] = cls
        cls.codec = codec_of(definition.id)
        cls.codec.makes(cls, finite=cls.finite)  # who had the codec already gets the class, too
        return cls

    return register


@cache
def codec_of(msgid: int) -> Codec:
    """The precompiled form of a message.

    Raises:
        UnknownMessage: the dialect has no message of this id.
    """
    if (definition := definitions().get(msgid)) is None:
        raise UnknownMessage(msgid)
    if (typed := TYPED.get(msgid)) is None:
        return Codec(definition, partial(_untyped, msgid))
    return Codec(definition, typed, finite=typed.finite)


def _untyped(msgid: int, *values: Value) -> Untyped:
    return Untyped(msgid, values)


def definition_of(message: AnyMessage) -> Definition:
    """What the dialect says about a message."""
    return message.codec.definition


def fields_of(message: AnyMessage) -> dict[str, Value]:
    """The values of a message by the names of its fields, in the order of the XML."""
    names = [field.name for field in message.codec.definition.fields]
    if isinstance(message, Untyped):
        return dict(zip(names, message.values, strict=True))
    return {name: getattr(message, name) for name in names}


def make(name: str, /, **fields: Value) -> AnyMessage:
    """Any message of the dialect from its name; fields that are left out are zero.

    Raises:
        UnknownMessage: the dialect has no message of this name.
        InvalidMessage: the message has no field of such a name.
    """
    if (definition := by_name().get(name)) is None:
        raise UnknownMessage(name)
    known = {field.name: _zero(field.type, field.length) for field in definition.fields}
    for field in fields:
        if field not in known:
            raise InvalidMessage(name, field, f"does not exist; it has {', '.join(known)}")
    message: AnyMessage = codec_of(definition.id).build(*(known | fields).values())
    return message


def _zero(kind: str, length: int) -> Value:
    if kind == "char":
        return ""
    if length:
        return bytes(length) if kind == "uint8_t" else (0,) * length
    return 0
