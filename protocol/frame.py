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

from robotree.protocol.codec import HEADER_BYTES, PACKING_ERRORS
from robotree.protocol.messages.base import AnyMessage, Untyped, fields_of

if TYPE_CHECKING:
    from robotree.protocol.codec import Codec

MAGIC = 0xFD
MAGIC_V1 = 0xFE
SIGNED = 0x01
"""The only incompatibility flag there is."""
SIGNATURE_BYTES = 13
HEADER_BYTES_V1 = 6
LARGEST_FRAME = 1 + HEADER_BYTES + 255 + 2 + SIGNATURE_BYTES
_START = b"\xfd"


class Signer(Protocol):
    """Gives a frame its signature."""

    def sign(self, frame: bytes) -> bytes:
        """The 13 bytes that follow a complete frame whose SIGNED flag is set."""
        ...


class Frame(msgspec.Struct, frozen=True, gc=False):
    """One intact frame as it came from the wire."""

    system: int
    component: int
    sequence: int
    msgid: int
    message: AnyMessage
    raw: bytes
    """The whole frame, checksum and signature included."""

    @property
    def signed(self) -> bool:
        """Whether it carries a signature (and, where the parser has a verifier, a good one)."""
        return self.raw[0] == MAGIC and bool(self.raw[2] & SIGNED)

    @property
    def version(self) -> int:
        """The MAVLink version of the frame: 1 or 2."""
        return 2 if self.raw[0] == MAGIC else 1

    @property
    def target(self) -> tuple[int, int]:
        """System and component that the message is addressed to; 0: to all."""
        if isinstance(self.message, Untyped):
            fields = fields_of(self.message)
            system, component = fields.get("target_system", 0), fields.get("target_component", 0)
        else:
            system = getattr(self.message, "target_system", 0)
            component = getattr(self.message, "target_component", 0)
        return (system if isinstance(system, int) else 0, component if isinstance(component, int) else 0)

    def is_for(self, system: int, *components: int) -> bool:
        """Whether the message is addressed to one of these components of a system, or to all."""
        to_system, to_component = self.target
        return to_system in (0, system) and to_component in (0, *components)

    @property
    def payload(self) -> bytes:
        """The payload as it was sent, without the zeros that were left out at its end."""
        start = 1 + HEADER_BYTES if self.raw[0] == MAGIC else HEADER_BYTES_V1
        return self.raw[start : start + self.raw[1]]


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
    codec = message.codec
    flat = codec.flatten_declared(message.values) if type(message) is Untyped else codec.flatten(message)
    flags = 0 if signer is None else SIGNED
    try:
        body = codec.pack(
            codec.length, flags, 0, sequence & 0xFF, system, component, codec.id_low, codec.id_high, *flat
        )
        if message.finite and not isfinite(sum(codec.floats(flat))):
            codec.require_finite(flat)
    except PACKING_ERRORS as error:
        raise codec.diagnose(flat) from error
    if not body[-1]:
        end = max(len(body.rstrip(b"\0")), HEADER_BYTES + 1)
        body = bytes((end - HEADER_BYTES,)) + body[1:end]
    frame = _START + body + mcrf4xx(body + codec.crc_extra).to_bytes(2, "little")
    return frame if signer is None else frame + signer.sign(frame)


def decode(raw: bytes, codec: Codec) -> Frame:
    """The value of one MAVLink 2 frame whose checksum was found good."""
    length = raw[1]
    if length >= codec.length:
        values = codec.unpack(raw, 1)
    else:
        values = codec.unpack(raw[1 : 1 + HEADER_BYTES + length] + bytes(codec.length - length))
    msgid = codec.definition.id
    return Frame(values[4], values[5], values[3], msgid, codec.build(*codec.declare(values)), raw)


def decode_v1(raw: bytes, codec: Codec) -> Frame:
    """The value of one MAVLink 1 frame whose checksum was found good; extensions read as zero."""
    length, sequence, system, component, msgid = raw[1:6]
    header = bytes((length, 0, 0, sequence, system, component, msgid, 0, 0))
    values = codec.unpack(header + raw[6 : 6 + length] + bytes(codec.length - length))
    return Frame(system, component, sequence, msgid, codec.build(*codec.declare(values)), raw)
