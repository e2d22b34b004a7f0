"""A MAVLink 2 frame: from a message to bytes, and the value that a parser hands out.

::

    FD, length, flags, flags, sequence, system, component, id (3), payload (0 to 255), crc (2), signature (13)

Zeros at the end of the payload are not sent, except for its first byte. The checksum is CRC-16/MCRF4XX from
the length to the payload, and then over one byte that stands for the message's definition.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Protocol

import msgspec
from fastcrc.crc16 import mcrf4xx
from msgspec.structs import force_setattr

from robotree.protocol.codec import HEADER, MAGIC, PACKING_ERRORS
from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages.base import AnyMessage, Untyped, fields_of

if TYPE_CHECKING:
    from robotree.protocol.codec import Codec

MAGIC_V1 = 0xFE
SIGNATURE_BYTES = 13
PROOF_BYTES = 6
"""The end of a signature, which proves the key by all that is before it."""
HEADER_BYTES = HEADER.size
HEADER_BYTES_V1 = 6
LARGEST_FRAME = HEADER_BYTES + 255 + 2 + SIGNATURE_BYTES
CRC_START = 0x3085
"""The magic byte, which the checksum does not cover, leads from here to its initial value, 0xFFFF."""
CRC_START_V1 = 0x3086


class Signer(Protocol):
    """Gives a frame its signature."""

    def sign(self, frame: bytes) -> bytes:
        """A complete frame whose SIGNED flag is set, and the 13 bytes that follow it."""
        ...


class Frame(msgspec.Struct, frozen=True, gc=False, eq=False):
    """One intact frame as it came from the wire. Equal when every byte is."""

    body: bytes
    """The frame up to the end of its payload."""
    codec: Codec
    checksum: int
    signature: bytes = b""
    """13 bytes; none: it is not signed."""
    made: AnyMessage | None = None
    """The message, once it was asked for; see `message`."""

    @classmethod
    def of(cls, message: AnyMessage, *, system: int = 1, component: int = 1, sequence: int = 0) -> Frame:
        """The frame in which a message would arrive."""
        raw = encode(message, sequence=sequence, system=system, component=component)
        return Frame(raw[:-2], message.codec, int.from_bytes(raw[-2:], "little"))

    @property
    def version(self) -> int:
        """The MAVLink version of the frame: 1 or 2."""
        return 2 if self.body[0] == MAGIC else 1

    @property
    def flags(self) -> int:
        """The incompatibility flags; 0 in MAVLink 1."""
        return self.body[2] if self.body[0] == MAGIC else 0

    @property
    def sequence(self) -> int:
        """The speaker's count of frames on this link, modulo 256."""
        return self.body[4 if self.body[0] == MAGIC else 2]

    @property
    def system(self) -> int:
        """The system that sent the frame."""
        return self.body[5 if self.body[0] == MAGIC else 3]

    @property
    def component(self) -> int:
        """Which part of it speaks."""
        return self.body[6 if self.body[0] == MAGIC else 4]

    @property
    def raw(self) -> bytes:
        """The whole frame as it came, checksum and signature included."""
        return self.body + self.checksum.to_bytes(2, "little") + self.signature

    @property
    def payload(self) -> bytes:
        """The payload as it came, without the zeros that were left out at its end."""
        return self.body[HEADER_BYTES if self.body[0] == MAGIC else HEADER_BYTES_V1 :]

    @property
    def signed(self) -> bool:
        """Whether it carries a signature (and, where the parser has a verifier, a good one)."""
        return bool(self.signature)

    @property
    def msgid(self) -> int:
        """The message's id."""
        return self.codec.definition.id

    @property
    def name(self) -> str:
        """The message's name on the wire."""
        return self.codec.definition.name

    @property
    def message(self) -> AnyMessage:
        """The message; made when first asked for, since many frames are only counted or passed on."""
        made = self.made
        if made is None:
            body, read = self.body, self.codec.read
            made = read(body, HEADER_BYTES if body[0] == MAGIC else HEADER_BYTES_V1)
            force_setattr(self, "made", made)
        return made

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Frame) and self.raw == other.raw

    def __hash__(self) -> int:
        return hash(self.raw)

    def __repr__(self) -> str:
        return f"<Frame {self.system}/{self.component} #{self.sequence} {self.message!r}>"

    @property
    def target(self) -> tuple[int, int]:
        """System and component that the message is addressed to; 0: to all."""
        message = self.message
        if isinstance(message, Untyped):
            fields = fields_of(message)
            system, component = fields.get("target_system", 0), fields.get("target_component", 0)
            return (system if isinstance(system, int) else 0, component if isinstance(component, int) else 0)
        return getattr(message, "target_system", 0), getattr(message, "target_component", 0)

    def is_for(self, system: int, *components: int) -> bool:
        """Whether the message is addressed to one of these components of a system, or to all."""
        to_system, to_component = self.target
        return to_system in (0, system) and to_component in (0, *components)


def encode(
    message: AnyMessage, *, sequence: int, system: int, component: int, signer: Signer | None = None
) -> bytes:
    """The bytes of one frame.

    Args:
        message: what to say.
        sequence: of this sender on this link; its low 8 bits are sent.
        system: who speaks, 1 to 255.
        component: which part of it speaks.
        signer: signs the frame; None: it is sent unsigned.

    Raises:
        InvalidMessage: a field cannot hold its value.
        UnknownMessage: the dialect has no such message.
    """
    frame = pack(message, sequence, system, component, signer)
    # As `close` does, without its call: this is what speed is promised of.
    frame += mcrf4xx(frame + message.codec.crc_extra, CRC_START).to_bytes(2, "little")
    return frame if signer is None else signer.sign(frame)


def pack(message: AnyMessage, sequence: int, system: int, component: int, signer: Signer | None) -> bytes:
    """The beginning of a frame, up to the end of its payload; its flags say whether it will be signed.

    Raises:
        InvalidMessage: a field cannot hold its value.
        UnknownMessage: the dialect has no such message.
    """
    codec = message.codec
    try:
        if type(message) is Untyped:
            flat = codec.flatten_declared(message.values)
        else:
            flatten = codec.flatten
            flat = flatten(message)
    except (TypeError, IndexError) as error:
        raise InvalidMessage(
            codec.definition.name, "*", f"has a value of the wrong kind ({error})"
        ) from error
    start = codec.start if signer is None else codec.start_signed
    try:
        # To add tuples is quicker than a call with single and starred arguments.
        head = (start, sequence & 0xFF, system, component, codec.id)
        frame = codec.pack(*(head + flat))
        if codec.finite and not isfinite(sum(flat)):
            codec.require_finite(flat)
    except PACKING_ERRORS as error:
        raise codec.diagnose(flat) from error
    if not frame[-1]:
        end = max(len(frame.rstrip(b"\0")), HEADER_BYTES + 1)
        frame = bytes((MAGIC, end - HEADER_BYTES)) + frame[2:end]
    return frame


def close(frame: bytes, codec: Codec, signer: Signer | None) -> bytes:
    """A whole frame from its beginning: with its checksum, and its signature."""
    frame += mcrf4xx(frame + codec.crc_extra, CRC_START).to_bytes(2, "little")
    return frame if signer is None else signer.sign(frame)
