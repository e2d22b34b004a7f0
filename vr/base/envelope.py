"""The envelope in which every request travels: who asks, when it was asked, and until when it may begin.

It is written by `seal` and read by `opened`, and nowhere else; `Received.expect_in_time` is the one place
where a request that has expired is refused. What was sent to a process that hangs lies in its socket and is
read when it wakes, however long ago its asker gave up: such a request must not begin.

On one machine all processes share one clock (CLOCK_MONOTONIC), so the moment of asking is sent as it is, and
the time that the way takes counts against the request, and against the deadline of a call. Clocks of
different machines cannot be compared: there a request is as new as its arrival, so only the remaining times
(`holds`, `Call.deadline`) count, from the arrival on.

The sender says only which of its robots or programs asks, and at which terminal the person sits. The process
and its user the transport knows from the kernel; see `principal.py`.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Generator
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from robotree.vr.base import requests as req
from robotree.vr.base.address import user_of
from robotree.vr.base.errors import Garbled, NoAnswer, NotAllowed
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.principal import (
    ASSISTANTS,
    SCRIPT,
    Credentials,
    Principal,
    principal_of,
    this_process,
    vouched,
)

FRESH = 3.0
"""[s] after which a request that begins something has expired at the latest: longer than a slow way takes,
and longer than it takes to see that a process hangs, so that an asker who gives up has little to wait."""

BEGINS = (
    *(req.Call, req.Attend, req.SetControl, req.Decide, req.Resume, req.Enslave, req.Free, req.Delete),
    *(req.Create, req.Reload, req.Migrate, req.Drain, req.SetPlacement, req.Disturb),
    *(req.Pause, req.TakeStep, req.Continue),
    *(req.WriteEntry, req.FindEntries, req.OpenTransaction, req.CloseTransaction, req.AcquireFence),
    *(req.LeaveOrder, req.ConfirmOrder, req.TakeOrder, req.TakeAlong, req.ReleaseHolds),
)
"""Requests that begin something: they must not begin after their asker gave up."""

ENDS = (
    *(req.SafeStop, req.Cancel, req.Release, req.Retract, req.GiveUp, req.RollBack),
    *(req.CancelOrder, req.HoldOrders, req.RobotDeleted),
)
"""Requests that end something: they are carried out however late they come.

All others only ask or prolong. `Detach` is one of these: it lets a motion go on without the one who has begun
it, so a late one must not count, and after the term of the bond its epoch is refused in any case.
"""

_OF_A_ROBOT = "robot/"
"""Begin of the key of each robot: it asks for nobody."""

_here = ""
"""The terminal at which the person sits for whom this process asks; empty: it asks for nobody."""

_assistant: ContextVar[str] = ContextVar("assistant", default="")
"""The assistant for whom this task asks; empty: it asks for whom the process does."""

_simulated = ""
"""The simulated clock that this process has; empty: the machine's."""


class Envelope(msgspec.Struct, frozen=True, array_like=True):
    """A request with who asks and until when it may begin."""

    request: req.AnyRequest
    sender: str
    """Key under which the asker is present; empty: it is present under none."""
    asked: float
    """[s] on the asker's clock."""
    holds: float
    """[s] from `asked` on in which it may begin; infinite: however late it comes."""
    clock: str
    """Which clock the asker has: see `this_clock`."""
    proof: bytes = b""
    """A `Voucher` of this machine's gateway, if it was asked on another one; else the kernel says who."""
    terminal: str = ""
    """At which the person sits for whom it is asked; empty: it is asked for no person, but for a robot."""
    may: Permissions | None = None
    """What the page of the robot that asks may do; None: it is not limited."""


class Sealed(NamedTuple):
    """A request that is ready to be sent."""

    body: bytes
    void_at: float
    """[s] on the asker's clock, when nobody begins with it any more; infinite: it is carried out however late
    it comes; 0: nothing depends on that."""


class Received(NamedTuple):
    """A request that has arrived."""

    request: req.AnyRequest
    principal: Principal
    asked: float
    """[s] on the clock of this process: when it was asked, or, from another machine, when it arrived."""
    holds: float
    """[s] from `asked` on in which it may begin."""
    may: Permissions | None = None
    """What the page of the asker may do, as its host says; None: it is not limited."""

    def expect_in_time(self, who: str, now: float) -> None:
        """Refuse a request whose asker has given up, or is about to.

        Args:
            who: is asked, for messages.
            now: [s] on the clock of this process.

        Raises:
            NoAnswer: it has expired.
        """
        if not now - self.asked < self.holds:
            raise NoAnswer(key=who, seconds=self.holds)


_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[Envelope] = msgspec.msgpack.Decoder(Envelope)


def seal(
    request: req.AnyRequest, *, now: float, within: float, sender: str = "", may: Permissions | None = None
) -> Sealed:
    """Put a request into its envelope.

    Args:
        request: what is asked.
        now: [s] on the machine's monotonic clock.
        within: [s] for which the asker waits for the first answer.
        sender: key under which the asker is present.
        may: what the page of the asker may do; None: it is not limited.
    """
    begins = isinstance(request, BEGINS)
    ends = not begins and isinstance(request, ENDS)
    holds = min(within, FRESH) if begins else math.inf if ends else within
    terminal = "" if sender.startswith(_OF_A_ROBOT) else _terminal()
    body = _encode(Envelope(request, sender, now, holds, this_clock(), b"", terminal, may))
    return Sealed(body, now + holds if begins or ends else 0.0)


def resealed(envelope: Envelope, request: req.AnyRequest, *, sender: str) -> bytes:
    """Return an envelope with another request, of another sender, who asks for the first one."""
    return _encode(msgspec.structs.replace(envelope, request=request, sender=sender, may=None))


def read_envelope(body: bytes) -> Envelope:
    """Read an envelope, whoever it is for.

    Raises:
        Garbled: it is none.
    """
    try:
        return _decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise Garbled(key="a caller", detail=str(error)) from None


def opened(body: bytes, credentials: Credentials, who: str, now: float, owner: int | None = None) -> Received:
    """Take a request out of its envelope.

    Args:
        body: as it came.
        credentials: of the process that has sent it.
        who: is asked, for messages.
        now: [s] on the machine's monotonic clock.
        owner: number of the user who shares the realm with others, and whose gateway is believed, too; None:
            nobody else is in the realm.

    Raises:
        Garbled: it cannot be read.
        NotAllowed: it says for whom it asks, and is of no gateway, or speaks for another user's agent.
        NoAnswer: it has expired: its asker has given up, or is about to.
    """
    envelope = read_envelope(body)
    asked = envelope.asked if same_clock(envelope.clock) and envelope.asked <= now else now
    principal = principal_of(credentials, envelope.sender, envelope.terminal)
    if envelope.proof:
        if credentials.user not in (os.geteuid(), owner):
            reason = "only the gateway of the realm's owner speaks for other sites"
            raise NotAllowed(who=principal.user, what=type(envelope.request).__name__, reason=reason)
        try:
            principal = vouched(envelope.proof, envelope.sender, envelope.terminal)
        except msgspec.MsgspecError as error:
            raise Garbled(key="a gateway", detail=str(error)) from None
    elif owner is not None and envelope.sender and credentials.user not in (owner, user_of(envelope.sender)):
        reason = f"it speaks for {envelope.sender}, which is no agent of this user"
        raise NotAllowed(who=principal.user, what=type(envelope.request).__name__, reason=reason)
    received = Received(envelope.request, principal, asked, envelope.holds, envelope.may)
    received.expect_in_time(who, now)
    return received


@contextlib.contextmanager
def sitting_at(terminal: str) -> Generator[None]:
    """Ask, inside the block, for a person who sits at a terminal; outside of it a process asks for nobody."""
    global _here  # noqa: PLW0603 # a process has one terminal
    before, _here = _here, terminal
    try:
        yield
    finally:
        _here = before


@contextlib.contextmanager
def asking_for_assistant(name: str) -> Generator[None]:
    """Ask for an assistant inside the block and the tasks that begin there.

    It has the rights that the policy gives it, and never more than the user of this process.
    """
    before = _assistant.set(name)
    try:
        yield
    finally:
        _assistant.reset(before)


def asking_assistant() -> str:
    """Return the assistant for whom this task asks; empty: none."""
    return _assistant.get()


def _terminal() -> str:
    name = _assistant.get()
    return f"{ASSISTANTS}/{name}" if name else _here


def asks_for_a_person() -> bool:
    """Whether this task asks for a person, or an assistant, at the moment; see `sitting_at`."""
    return _terminal() != ""


def asking_person() -> str:
    """Return the person for whom this task asks, as robots of this machine name it; empty: there is none."""
    return principal_of(this_process(), "", _terminal()).person


def this_terminal() -> str:
    """Return the terminal of this process as `who` prints it, `pts/3`; `SCRIPT` where there is none."""
    for stream in range(3):
        with contextlib.suppress(OSError):
            return os.ttyname(stream).removeprefix("/dev/")
    return SCRIPT


def this_clock() -> str:
    """Return a name of the monotonic clock of this process; empty: it cannot be compared with another one.

    Processes have the same clock if they share the boot of a machine and a time namespace
    (time_namespaces(7)), as containers on one machine usually do.
    """
    return _simulated or _clock_of_this_machine()


def same_clock(name: str) -> bool:
    """Whether moments on a clock can be compared with those of this process; see `this_clock`."""
    return name != "" and name == this_clock()


@contextlib.contextmanager
def on_clock(name: str) -> Generator[None]:
    """Have all processes inside the block share one simulated clock."""
    global _simulated  # noqa: PLW0603 # one simulation at a time
    before, _simulated = _simulated, name
    try:
        yield
    finally:
        _simulated = before


@cache
def _clock_of_this_machine() -> str:
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""
    try:
        return f"{boot[:13]}{Path('/proc/self/ns/time').readlink()}"
    except OSError:  # a kernel without time namespaces (before Linux 5.6)
        return boot[:13]
