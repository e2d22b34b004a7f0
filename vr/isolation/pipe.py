"""Frames between a host and a robot in a process of its own, and the socket that carries them.

Each frame is a MessagePack array behind its length (u32, little-endian). Frames of one direction arrive in
the order in which they were sent.
"""

from __future__ import annotations

import socket
import struct
import threading
from typing import Literal

import msgspec

from robotree.vr.base.permissions import Isolation, Permissions
from robotree.vr.base.presence import Held
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import (
    Cancel,
    Create,
    Migrate,
    ReadEvents,
    Reload,
    SafeStop,
    TakeRobot,
    VerifyEvents,
)
from robotree.vr.core.placement import PlaceAdvice, PlacedRobot

LARGEST = 16 * 1024 * 1024
"""[bytes] of a frame."""
HEAD = struct.Struct("<I")


class PipeFrame(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """Something that one side tells the other one."""


class Rules(PipeFrame, frozen=True):
    """The policy of the realm, as the host knows it: see `PolicyGate`."""

    text: str
    """Empty: there is none."""
    trouble: str
    site: str
    person: bool
    roles: tuple[str, ...]
    owner: int | None
    user: int | None = None
    """Number of the user whose agent the robot is, where several users share the realm."""


class Parcel(msgspec.Struct, frozen=True):
    """A robot that has come from another host, for the process that is to go on with it."""

    sent: TakeRobot
    """As it came; its state is as the host has it now."""
    now: float
    """[s] on the monotonic clock of the host, when it came; so is the next, since 1970."""
    unix: float


class BeginFrame(PipeFrame, frozen=True):
    """The first frame to a process: which robot it is to be."""

    name: str
    host: str
    """Name of the host."""
    realm: str
    process: int
    """Number of the host's process, under which others see the robot's requests."""
    user: int
    folder: str
    """In which the robot is kept; empty: it is not."""
    term: float
    """[s] of leases."""
    returns: float
    """[s] in which the robots of this host come back."""
    limit: float
    """[s] for a page to run."""
    create: Create | None
    """The new robot; None: it goes on from its folder."""
    arrives: bool
    """Whether that robot comes from another host: `parcel`, or `Arrive` later, has the rest."""
    parcel: Parcel | None
    asker: Principal
    """Who has made it."""
    level: Isolation
    permissions: Permissions | None
    """Of its page, which the host has admitted; None: it is not limited."""
    abandon: str
    """Why its open commands end before it goes on; empty: they go on."""
    note: str
    """What is written into its log first; empty: nothing."""
    left: list[SafeStop | Cancel]
    """What it obeys before anything of it goes on: see `KeptApart.left`."""
    rules: Rules
    writable: list[str]
    """Folders in which it may write."""


class Come(PipeFrame, frozen=True):
    """A request to the robot."""

    number: int
    body: bytes
    process: int
    user: int
    urgent: bool


class Replied(PipeFrame, frozen=True):
    """A reply to what the robot has asked; None: there are no more."""

    number: int
    body: bytes | None


class Sampled(PipeFrame, frozen=True):
    """A sample of a subscription."""

    number: int
    key: str
    body: bytes


class Present(PipeFrame, frozen=True):
    """An agent has come or gone."""

    key: str
    there: bool
    left: bool


class Silent(PipeFrame, frozen=True):
    """The agents in processes that certainly hang, all of them."""

    held: list[Held]


class Did(PipeFrame, frozen=True):
    """The answer to `Announce` and `Settle`."""

    number: int
    others: list[str]
    """Who is present under the keys that should be free; empty: it was done."""


class Control(PipeFrame, frozen=True):
    """A request of the host itself: `Reload`, `Migrate`, `ReadEvents`, … Answered by `Answered`."""

    number: int
    request: Reload | Migrate | ReadEvents | VerifyEvents
    principal: Principal
    permissions: Permissions | None
    """Of the page with which it is to go on."""


class Place(PipeFrame, frozen=True):
    """What a look at the robot's place has shown, or what follows: see `Placeable`."""

    does: Literal["show", "begin_move", "end_move"]
    advice: PlaceAdvice
    text: str


class Leave(PipeFrame, frozen=True):
    """End politely."""

    returns: bool
    """Whether it will be started again."""


class Arrive(PipeFrame, frozen=True):
    """The robot for which the process has loaded the page is here: it is to go on with it."""

    parcel: Parcel


class Loaded(PipeFrame, frozen=True):
    """The page is loaded of a robot that comes."""


class Serve(PipeFrame, frozen=True):
    """The robot answers under a key, or no longer."""

    key: str
    on: bool
    rank: int
    """How often it has moved: see `Transport.serve`."""


class Announce(PipeFrame, frozen=True):
    """The robot is present under a key. Answered by `Did`."""

    number: int
    key: str
    unless: list[str]


class Withdraw(PipeFrame, frozen=True):
    """The robot is present no longer."""

    key: str


class Settle(PipeFrame, frozen=True):
    """Answered by `Did` when what was announced is known to all others."""

    number: int


class Ask(PipeFrame, frozen=True):
    """A request of the robot."""

    number: int
    key: str
    body: bytes
    void_at: float
    urgent: bool


class Publish(PipeFrame, frozen=True):
    """A sample of the robot."""

    key: str
    body: bytes


class Subscribe(PipeFrame, frozen=True):
    """The robot wants samples."""

    number: int
    pattern: str


class Unsubscribe(PipeFrame, frozen=True):
    """And no longer."""

    number: int


class ReplyBack(PipeFrame, frozen=True):
    """A reply of the robot to a request."""

    number: int
    body: bytes


class EndBack(PipeFrame, frozen=True):
    """The end of the replies to a request, with one more or with None."""

    number: int
    body: bytes | None


class Answered(PipeFrame, frozen=True):
    """The reply to `Control`."""

    number: int
    body: bytes


class Up(PipeFrame, frozen=True):
    """The robot can be called."""

    description: bytes
    """`Described`, encoded."""
    page: str
    """Hash of its page."""


class FailedFrame(PipeFrame, frozen=True):
    """There is no robot: an encoded `Raised` says why."""

    body: bytes


class Alive(PipeFrame, frozen=True):
    """A sign of life."""

    abandoned: list[str]
    """Commands that were ended and whose code still runs."""
    on_way: str
    """Name of the host to which it is moving; empty: it stays."""
    placed: PlacedRobot | None
    """What matters for its place; None: people alone move it."""
    came: bool
    """Whether it has come from another host."""


class GoneFrame(PipeFrame, frozen=True):
    """The robot was deleted."""


ToRobot = (
    BeginFrame | Arrive | Come | Replied | Sampled | Present | Silent | Rules | Did | Control | Place | Leave
)
FromRobot = (
    Loaded
    | Serve
    | Announce
    | Withdraw
    | Settle
    | Ask
    | Publish
    | Subscribe
    | Unsubscribe
    | ReplyBack
    | EndBack
    | Answered
    | Up
    | FailedFrame
    | Alive
    | GoneFrame
)

_encode = msgspec.msgpack.Encoder().encode
to_robot: msgspec.msgpack.Decoder[ToRobot] = msgspec.msgpack.Decoder(ToRobot)
from_robot: msgspec.msgpack.Decoder[FromRobot] = msgspec.msgpack.Decoder(FromRobot)


def packed(frame: PipeFrame) -> bytes:
    """Return a frame behind its length."""
    body = _encode(frame)
    return HEAD.pack(len(body)) + body


class RobotPipe:
    """The robot's end of the socket. `send` may be called from any thread; one thread receives."""

    def __init__(self, own: socket.socket) -> None:
        """Take a connected stream socket."""
        own.setblocking(True)
        self._socket = own
        self._lock = threading.Lock()
        self._reader = own.makefile("rb")

    def send(self, frame: PipeFrame) -> None:
        """Send a frame; waits while the host takes nothing.

        Raises:
            OSError: the host has gone.
        """
        data = packed(frame)
        with self._lock:
            self._socket.sendall(data)

    def receive(self) -> ToRobot | None:
        """Return the next frame; None: the host has gone."""
        head = self._reader.read(HEAD.size)
        if len(head) < HEAD.size:
            return None
        (size,) = HEAD.unpack(head)
        body = self._reader.read(size)
        return to_robot.decode(body) if len(body) == size else None
