"""What two gateways say to each other, inside the sealed stream, and what requests say on this way. Pure."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import msgspec

from robotree.vr.base.envelope import BEGINS, ENDS, Envelope, same_clock, this_clock
from robotree.vr.base.permit import Permit
from robotree.vr.base.principal import Voucher
from robotree.vr.base.requests import Call, Resume


class Announced(IntEnum):
    """What a site lets others know."""

    PRESENT = 0
    """Somebody is present under a key there, and answers requests to it."""
    WANTED = 1
    """Somebody there subscribes to a pattern."""


class AllNews(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """All that a site lets others know: the first frames of a session."""

    keys: list[str]
    patterns: list[str]
    more: bool
    """Another one follows with the rest."""
    ranks: dict[str, int] = {}
    """Those of these keys that have one: see `Transport.serve`."""


class OneNews(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """One change of it."""

    topic: Announced
    key: str
    there: bool
    rank: int = 0
    """See `AllNews.ranks`."""


class SiteAsk(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """A request to an agent of the other site."""

    number: int
    key: str
    body: bytes
    """The envelope, as it was asked."""
    urgent: bool
    sent: float
    """[s] on the sender's clock."""
    age: float
    """[s] since it was asked, when it was sent."""
    user: str
    """Whose process asked, as the kernel there says."""
    process: int
    permit: Permit | None = None
    """Of an assistant's call that needs one: what the folder of the realm there has of it."""


class SiteReply(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """One reply to it."""

    number: int
    body: bytes


class SiteEnd(msgspec.Struct, frozen=True, array_like=True, tag=4):
    """There are no more replies."""

    number: int
    elsewhere: bool = False
    """Nobody has answered, for the agent is not at this site any more."""


class SiteSample(msgspec.Struct, frozen=True, array_like=True, tag=5):
    """Something published."""

    key: str
    body: bytes


class Revoked(msgspec.Struct, frozen=True, array_like=True, tag=6):
    """The newest list of revoked certificates, as the authority signed it."""

    packed: bytes


class StopSite(msgspec.Struct, frozen=True, array_like=True, tag=7):
    """An order: stop all robots of the site. It is carried out there, however late it comes."""

    number: int
    order: str
    reason: str


class SiteStopped(msgspec.Struct, frozen=True, array_like=True, tag=8):
    """What came of it."""

    number: int
    confirmed: list[str]
    missed: list[tuple[str, str]]
    """Names of robots that have not confirmed, and why."""
    advice: list[str]


class SiteState(msgspec.Struct, frozen=True, array_like=True, tag=20):
    """The state of a robot, as it published it."""

    number: int
    """By which `StillSo` speaks of this robot."""
    key: str
    body: bytes


class StillSo(msgspec.Struct, frozen=True, array_like=True, tag=21):
    """The states that robots have published again, as they were sent."""

    states: list[tuple[int, int]]
    """Number of the robot, and checksum of the state that is meant."""


class AgainStates(msgspec.Struct, frozen=True, array_like=True, tag=22):
    """The states that the other site lacks."""

    numbers: list[int]


class AboutSite(msgspec.Struct, frozen=True, array_like=True, tag=23):
    """What a gateway says of itself, first of all."""

    version: str
    wall: float
    """[s since 1970] its clock, when this left. Only people compare it (`robotree doctor`)."""


class Admitted(msgspec.Struct, frozen=True, array_like=True, tag=24):
    """Certificates of sites that belong to the realm, also of those that nobody has heard yet."""

    certificates: list[bytes]


class Hung(msgspec.Struct, frozen=True, array_like=True, tag=25):
    """The agents of a site whose processes hang there."""

    agents: list[tuple[str, str, str]]
    """Key, process, and the remedy for a person who is there."""


class SitePolicy(msgspec.Struct, frozen=True, array_like=True, tag=9):
    """The policy in force, as the authority has signed it."""

    data: bytes


SiteFrame = (
    AllNews | OneNews | SiteAsk | SiteReply | SiteEnd | SiteSample | Revoked | StopSite | SiteStopped
    | SiteState | StillSo | AgainStates | AboutSite | Admitted | Hung
    | SitePolicy
)  # fmt: skip

encode_frame = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[SiteFrame] = msgspec.msgpack.Decoder(SiteFrame)


def decode_frame(body: bytes) -> SiteFrame | None:
    """Return a frame; None: it cannot be read, and comes from another version."""
    try:
        return _decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None


# -- a request on its way: what its envelope says of clocks and of who asks ------------------------

_encode = msgspec.msgpack.Encoder().encode
_envelope: msgspec.msgpack.Decoder[Envelope] = msgspec.msgpack.Decoder(Envelope)


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
        return _envelope.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None
