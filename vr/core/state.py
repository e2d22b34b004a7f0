"""All that a robot is, as one value: encoded and decoded again, the robot goes on as if nothing was."""

from __future__ import annotations

from typing import Any

import msgspec

from robotree.vr.address import Address
from robotree.vr.core.bonds import Slots
from robotree.vr.core.calls import Calls
from robotree.vr.core.lease import Lessor
from robotree.vr.core.stop import Stop


class State(msgspec.Struct, kw_only=True):
    """See the module."""

    address: Address
    """Its name for life, and its incarnation: another one for each start."""
    home: str
    """What a person restarts to end its code, in words: `host host-1`."""
    lease: Lessor
    """Who commands it."""
    slots: Slots
    """Which robots it commands."""
    calls: Calls
    stop: Stop
    fields: dict[str, Any] = {}
    """Its settings and what its page has declared as state: plain values by name."""


_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[State] = msgspec.msgpack.Decoder(State)


def encode_state(state: State) -> bytes:
    """Return a state as MessagePack."""
    return _encoder.encode(state)


def decode_state(body: bytes) -> State:
    """Read what `encode_state` wrote.

    Raises:
        msgspec.DecodeError: it is something else.
    """
    return _decoder.decode(body)
