"""What two gateways say to each other, inside the sealed stream. Pure."""

from __future__ import annotations

from enum import IntEnum

import msgspec

from robotree.vr.base.permit import Permit


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
