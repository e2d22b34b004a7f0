"""The base of all messages, and their registry. Everything about messages that is written by hand.

A message that robotree speaks is a class below `Message`, decorated with its name on the wire; its fields are
those of the XML, in the same order. The classes of the dialect are generated (`messages/__init__.py`); a kind
of robot may add classes for its own dialect in the same way. Every other message is an `Untyped`.

There is one registry in a process: the dialect, what `wire` and `extend` add to it, and the codecs of both.
"""

from __future__ import annotations

import sys
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import msgspec

from robotree.protocol.codec import Codec
from robotree.protocol.dialect.table import LARGEST_ID, by_name, definitions
from robotree.protocol.errors import InvalidMessage, UnfitClass, UnknownMessage

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.protocol.codec import Value
    from robotree.protocol.dialect.table import Definition


class Message(msgspec.Struct, frozen=True, gc=False):
    """A typed message. Immutable; equal when type and values are."""

    codec: ClassVar[Codec]
    finite: ClassVar[bool] = False
    """Whether NaN and infinity are forbidden when we send it. Only for messages of nothing but numbers."""


class SecretMessage(Message, frozen=True, gc=False):
    """A typed message with a secret: its text never shows the fields in `SECRETS`."""

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={value!r}" for name, value in self.__rich_repr__())
        return f"{type(self).__name__}({shown})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:  # msgspec's would show every field
        secrets = self.codec.definition.secrets
        return [(name, ... if name in secrets else getattr(self, name)) for name in self.__struct_fields__]


class GoalStateBase(IntEnum):
    """The methods of the generated `GoalState`."""

    @property
    def final(self) -> bool:
        """Whether the goal has ended."""
        return self >= type(self)["SUCCEEDED"]


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


def wire(name: str, *, xml: str = "") -> Callable[[type[M]], type[M]]:
    """Class decorator: this class is the message `name` of the dialect.

    A message has one class in a process. Where it has one already, as from another robot of the same file,
    that one is returned instead of the decorated.

    Args:
        name: of the message.
        xml: the file that has it, if it is none of robotree's: seen from the folder of the class's own file.

    Raises:
        DialectError: `xml` is wrong, or a message in it is one that is known, and another one.
        UnknownMessage: there is no such message.
        UnfitClass: the class has other fields than the message.
    """

    def register(cls: type[M]) -> type[M]:
        if xml:
            from robotree.protocol.dialect.extension import extend  # the generator takes its time to import

            extend(_folder_of(cls) / xml)
        if (definition := by_name().get(name)) is None:
            remedy = (
                f"add it to {xml}" if xml else f'name the XML that has it: @wire("{name}", xml="FILE.xml")'
            )
            raise UnknownMessage(name, remedy)
        fields = tuple(field.name for field in definition.fields)
        if cls.__struct_fields__ != fields:
            raise UnfitClass(cls.__name__, name, fields)
        if (known := TYPED.get(definition.id)) is not None:
            return cast("type[M]", known)
        TYPED[definition.id] = cls
        cls.codec = codec_of(definition.id)
        cls.codec.makes(cls, finite=cls.finite)  # who had the codec already gets the class, too
        return cls

    return register


def _folder_of(cls: type) -> Path:
    """Where the file of a class lies; the working directory when it has none, as at a prompt."""
    return Path(getattr(sys.modules.get(cls.__module__), "__file__", None) or "").parent


class _Codecs(dict[bytes, "Codec | None"]):
    """Codecs by the three bytes of the id on the wire, compiled when first met."""

    def __missing__(self, key: bytes) -> Codec | None:
        msgid = int.from_bytes(key, "little")
        if (definition := definitions().get(msgid)) is None:
            return None  # not remembered: a stream may hold 16 million of them
        typed = TYPED.get(msgid)
        build, finite = (partial(_untyped, msgid), False) if typed is None else (typed, typed.finite)
        found = self[key] = Codec(definition, build, finite=finite)
        return found


CODECS = _Codecs()
"""The precompiled form of every message that was met; None for an id that the dialect does not have."""


def codec_of(msgid: int) -> Codec:
    """The precompiled form of a message.

    Raises:
        UnknownMessage: the dialect has no message of this id.
    """
    codec = CODECS[msgid.to_bytes(3, "little")] if 0 <= msgid <= LARGEST_ID else None
    if codec is None:
        raise UnknownMessage(msgid)
    return codec


def _untyped(msgid: int, *values: Value) -> Untyped:
    return Untyped(msgid, values)


def definition_of(message: AnyMessage) -> Definition:
    """The definition of a message in the dialect."""
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
