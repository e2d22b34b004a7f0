"""A request on its way between two machines: what its envelope says of clocks and of who asks. Pure."""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec

from robotree.vr.base.envelope import BEGINS, ENDS, Envelope, same_clock, this_clock
from robotree.vr.base.permit import Permit
from robotree.vr.base.principal import Voucher
from robotree.vr.base.requests import Call, Resume

_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[Envelope] = msgspec.msgpack.Decoder(Envelope)


class Leaving(NamedTuple):
    """What is known of a request that leaves."""

    age: float
    """[s] since it was asked."""
    void_at: float
    """[s] on the own clock, after which nobody begins with it; 0: it begins nothing."""
    vouched: bool
    """It has come from another site already."""
    permit: str
    """Id of the permit with which an assistant asks; empty: it has none."""


class Arrived(NamedTuple):
    """A request that has arrived, with an envelope of this machine."""

    body: bytes
    void_at: float
    """[s] on the own clock, as in `Leaving`; infinite: of one that ends something."""
    expired: bool
    """Whether it must not begin any more."""


def leaving(body: bytes, now: float) -> Leaving | None:
    """Look into a request that leaves for another machine; None: it cannot be read.

    Args:
        body: the envelope.
        now: [s] on this machine's monotonic clock.
    """
    envelope = _read(body)
    if envelope is None:
        return None
    age = max(now - envelope.asked, 0.0) if same_clock(envelope.clock) else 0.0
    begins = isinstance(envelope.request, BEGINS)
    void_at = now - age + envelope.holds if begins else 0.0
    permit = envelope.request.permit if isinstance(envelope.request, Call) else ""
    return Leaving(age, void_at, bool(envelope.proof), permit)


def sender_of(body: bytes) -> str:
    """Return the key under which the asker is present; empty: under none, or it cannot be read."""
    envelope = _read(body)
    return "" if envelope is None else envelope.sender


def arrived(
    body: bytes, age: float, voucher: Voucher, now: float, *, known: bool, permit: Permit | None = None
) -> Arrived | None:
    """Write the envelope of a request anew for this machine; None: it cannot be read.

    Args:
        body: as it was asked on the other machine.
        age: [s] since then, the way included.
        voucher: who asks.
        now: [s] on this machine's monotonic clock.
        known: whether the asker is present at its site under the key that it says; else it is under none.
        permit: of a call that needs one, as its site vouches for it, on this machine's clock.
    """
    envelope = _read(body)
    if envelope is None:
        return None
    asked, request = now - age, envelope.request
    if isinstance(request, Resume) and request.given != math.inf:
        given = asked - max(envelope.asked - request.given, 0.0) if request.clock == envelope.clock else asked
        request = msgspec.structs.replace(request, given=given, clock=this_clock())
    if isinstance(request, Call) and (permit is not None or request.vouched is not None):
        request = msgspec.structs.replace(request, vouched=permit if request.permit else None)
    body = _encode(
        msgspec.structs.replace(
            envelope,
            request=request,
            sender=envelope.sender if known else "",
            asked=asked,
            clock=this_clock(),
            proof=_encode(voucher),
        )
    )
    begins, ends = isinstance(request, BEGINS), isinstance(request, ENDS)
    void_at = asked + envelope.holds if begins else math.inf if ends else 0.0
    return Arrived(body, void_at, begins and age >= envelope.holds)


def _read(body: bytes) -> Envelope | None:
    try:
        return _decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
