"""The judge of what comes from a robot in a process of its own. Pure.

The robot may be code that nobody here has read. It speaks for itself alone: under its own name, with its own
key, to robots, lookup services and spaces, and with none of the requests by which people shape a realm.
Whatever else it tries is no mistake of an author, so it ends the process.
"""

from __future__ import annotations

from robotree.vr.base.address import Address
from robotree.vr.base.envelope import read_envelope
from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.requests import (
    AcquireFence,
    AnyRequest,
    Call,
    Cancel,
    CloseTransaction,
    Continue,
    Describe,
    DescribeSpace,
    Detach,
    FindEntries,
    GiveUp,
    OpenTransaction,
    Pause,
    Petition,
    Query,
    Register,
    Release,
    Renew,
    RenewEntry,
    RenewFence,
    Retract,
    RobotDeleted,
    RollBack,
    SafeStop,
    TakeStep,
    WatchEntries,
    WriteEntry,
)

ALLOWED: dict[str, tuple[type[AnyRequest], ...]] = {
    "robot": (
        *(Describe, Call, Detach, Cancel, Petition, Retract, Renew, Release, SafeStop),
        *(Pause, TakeStep, Continue),
    ),
    "lookup": (Register, Query),
    "directory": (Register, Query, RobotDeleted),
    "space": (
        *(WriteEntry, FindEntries, GiveUp, RenewEntry, OpenTransaction, CloseTransaction, RollBack),
        *(AcquireFence, RenewFence, WatchEntries, DescribeSpace),
    ),
}
"""What a robot may ask, by the role of whom it asks."""

OF_PARENTS = (Petition, Retract, Renew, Release)
NAMELESS = (Describe, Register, Query)
"""Requests that may come without a sender."""


class Misbehaved(Exception):
    """A robot tried what no robot does; the text is a clause for people."""


class Judge:
    """Judges the frames of one robot."""

    def __init__(self, name: str, permissions: Permissions | None = None) -> None:
        """Begin with a robot whose address is not known yet.

        Args:
            name: of the robot.
            permissions: of its page; None: it is not limited.
        """
        self.name = name
        self.permissions: tuple[Permissions | None, ...] = (permissions,)
        """Those of its page; while that is being changed, those of both."""
        self.identity = ""
        """For life, as it describes itself first."""
        self.key = ""
        """Of its address: the first one under which it answers."""

    def expect_own(self, key: str) -> None:
        """Refuse a key under which another one answers or is present.

        Raises:
            Misbehaved: it is not this robot's.
        """
        address = Address.parse(key)
        if address is None or address.role != "robot" or address.name != self.name:
            raise Misbehaved(f"it wanted to be {_shown(key)}")
        if self.key not in ("", key):
            raise Misbehaved(f"it wanted to be {_shown(key)} beside itself")
        self.key = key

    def expect_asked(self, key: str, body: bytes) -> None:
        """Refuse a request that no robot makes.

        Args:
            key: of whom it asks.
            body: an envelope.

        Raises:
            Misbehaved: it is one.
        """
        try:
            envelope = read_envelope(body)
        except VrError as error:
            raise Misbehaved(f"it asked {_shown(key)} in a way that cannot be read: {error}") from None
        request, what = envelope.request, type(envelope.request).__name__
        role = key.partition("/")[0]
        if not isinstance(request, ALLOWED.get(role, ())):
            raise Misbehaved(f"it asked {_shown(key)} for {what}, which no robot does")
        nameless = not envelope.sender and isinstance(request, NAMELESS)
        if envelope.terminal or envelope.proof or (envelope.sender != self.key and not nameless):
            raise Misbehaved(f"it asked {_shown(key)} for {what} in the name of somebody else")
        if envelope.may not in self.permissions and role == "robot" and not nameless:
            raise Misbehaved(f"it asked {_shown(key)} for {what} with other permissions than its page has")
        if isinstance(request, OF_PARENTS) and request.parent.key != self.key:
            raise Misbehaved(f"it asked {_shown(key)} for {what} as {_shown(request.parent.key)}")
        if isinstance(request, RobotDeleted) and request.identity != (self.identity or f"name:{self.name}"):
            raise Misbehaved("it wanted another robot to be forgotten")
        if isinstance(request, Register) and any(one.address.key != self.key for one in request.listings):
            raise Misbehaved("it wanted to list another robot")
        if isinstance(request, Register) and any(one.key != self.key for one, _ in request.withdrawn):
            raise Misbehaved("it wanted to take another robot out of the lookup")

    def expect_published(self, key: str) -> None:
        """Refuse a sample under another one's key.

        Raises:
            Misbehaved: it is.
        """
        if not self.key or not key.startswith(f"{self.key}/"):
            raise Misbehaved(f"it published as {_shown(key)}")

    def expect_subscribed(self, pattern: str) -> None:
        """Refuse to hand on what is no robot's.

        Raises:
            Misbehaved: it wants to hear somebody else.
        """
        if not pattern.startswith(("robot/", "space/")):
            raise Misbehaved(f"it wanted to hear {_shown(pattern)}")


def _shown(key: str) -> str:
    return repr(key if len(key) < 100 else f"{key[:97]}...")
