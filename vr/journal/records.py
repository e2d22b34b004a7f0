"""What stands in the log of a host: what its robots are made of, what they were, what happened to them."""

from __future__ import annotations

import msgspec

from robotree.vr.base.permissions import SignedManifest
from robotree.vr.base.plain import to_plain
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import RobotState

VERSION = 1
"""Of the format; a log of another one is not read."""


class _LogRecord(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """One record."""


class Began(_LogRecord, frozen=True):
    """A life of the host begins, or a segment: the first record of each segment."""

    version: int
    life: int
    """How often the host was started with this log."""
    boot: str
    """Of the machine: monotonic moments hold within one."""
    unix: float
    """[s] since 1970."""
    now: float
    """[s] on the monotonic clock, at the same moment."""
    host: str = ""
    """Name of the host's folder; empty: an earlier version has written it."""


class KeptPage(msgspec.Struct, frozen=True):
    """The source of a robot, as it came: the file at its author's may be another one by now."""

    source: str
    path: str
    wanted: str = ""
    files: dict[str, bytes] = {}
    origin: str = ""
    """Where a reload finds it."""
    signed: SignedManifest | None = None
    """What its signer says of it."""
    sender: str = ""
    """Who has sent it unsigned, if that was not this user."""
    service: str = ""
    """Name of the service of this host whose behaviour the robot is; empty: it is nobody's."""


class Made(_LogRecord, frozen=True):
    """A robot was made, or is carried over from an older segment."""

    robot: int
    """Number by which the records of this log name it."""
    key: str
    name: str
    page: KeptPage


class PageOffered(_LogRecord, frozen=True):
    """A robot goes on with another page, if `PageReloaded` follows."""

    robot: int
    page: KeptPage


class StateKept(_LogRecord, frozen=True):
    """The whole state of a robot."""

    robot: int
    state: RobotState


class Happened(_LogRecord, frozen=True):
    """The machine of a robot has taken an event."""

    robot: int
    now: float
    """[s] on the monotonic clock, as the machine was told."""
    event: CoreEvent


class Deleted(_LogRecord, frozen=True):
    """A robot was deleted."""

    robot: int


class MovedOut(_LogRecord, frozen=True):
    """A robot is on its way to another host; who has it is not known here until `MovedBack` or `Deleted`."""

    robot: int
    transfer: str
    host: str
    """Name of the other host."""
    log: str
    """Name of the log in which that host writes what it takes."""
    secret: str
    """See `core.heirs`."""


class MovedBack(_LogRecord, frozen=True):
    """It has not moved, and never will under that transfer."""

    robot: int


class CameHere(_LogRecord, frozen=True):
    """A robot has come from another host: the one record that decides that it is here."""

    robot: int
    key: str
    name: str
    page: KeptPage
    transfer: str
    state: RobotState
    now: float
    """[s] on the monotonic clock, when it came."""


class CameApart(_LogRecord, frozen=True):
    """A robot has come that lives in a process of its own: this decides that it is here.

    What it is lies in its folder, where it was written before.
    """

    transfer: str


class NeverTaken(_LogRecord, frozen=True):
    """A robot that was to come never does under this transfer; written before anybody is told."""

    transfer: str


class Transfers(_LogRecord, frozen=True):
    """What became of the robots that were to come, carried over from an older segment."""

    taken: tuple[str, ...]
    never: tuple[str, ...]


class Whole(_LogRecord, frozen=True):
    """This segment has the state of all robots: what is older is not needed any more."""


LogRecord = (
    Began | Made | PageOffered | StateKept | Happened | Deleted | Whole
    | MovedOut | MovedBack | CameHere | CameApart | NeverTaken | Transfers
)  # fmt: skip

encoder = msgspec.msgpack.Encoder(enc_hook=to_plain)
decoder: msgspec.msgpack.Decoder[list[LogRecord]] = msgspec.msgpack.Decoder(list[LogRecord])
