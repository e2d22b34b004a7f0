"""The envelope in which every request travels: who asks, when it was asked, and until when it may begin.

It is written by `seal` and read by `opened`, and nowhere else; `opened` is the one place where a request that
has expired is refused. What was sent to a process that hangs lies in its socket and is read when it wakes,
however long ago its asker gave up: such a request must not begin.

On one machine all processes share one clock (CLOCK_MONOTONIC), so the moment of asking is sent as it is, and
the time that the way takes counts against the request, and against the deadline of a call. Clocks of
different machines cannot be compared: there a request is as new as its arrival, so only the remaining times
(`holds`, `Call.deadline`) count, from the arrival on.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Generator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from robotree.vr.base.errors import Garbled, NoAnswer
from robotree.vr.base.requests import (
    AnyRequest,
    Call,
    Cancel,
    Create,
    Delete,
    Enslave,
    Free,
    Release,
    Reload,
    Resume,
    Retract,
    SafeStop,
)

FRESH = 3.0
"""[s] after which a request that begins something has expired at the latest: longer than a slow way takes,
and longer than it takes to see that a process hangs, so that an asker who gives up has little to wait."""

BEGINS = (Call, Resume, Enslave, Free, Delete, Create, Reload)
"""Requests that begin something: they must not begin after their asker gave up."""

ENDS = (SafeStop, Cancel, Release, Retract)
"""Requests that end something: they are carried out however late they come.

All others only ask or prolong. `Detach` is one of these: it lets a motion go on without the one who has begun
it, so a late one must not count, and after the term of the bond its epoch is refused in any case.
"""

_simulated = ""
"""The simulated clock that this process has; empty: the machine's."""


class Envelope(msgspec.Struct, frozen=True, array_like=True):
    """See the module."""

    request: AnyRequest
    sender: str
    """Key under which the asker is present; empty: it is present under none."""
    asked: float
    """[s] on the asker's clock."""
    holds: float
    """[s] from `asked` on in which it may begin; infinite: however late it comes."""
    clock: str
    """Which clock the asker has: see `this_clock`."""
    proof: bytes = b""
    """Room for what proves the sender. On one machine the kernel vouches for the user of each process."""


class Sealed(NamedTuple):
    """A request that is ready to be sent."""

    body: bytes
    void_at: float
    """[s] on the asker's clock, when nobody begins with it any more; infinite: it is carried out however late
    it comes; 0: nothing depends on that."""


class Received(NamedTuple):
    """A request that has arrived in time."""

    request: AnyRequest
    sender: str
    asked: float
    """[s] on the clock of this process: when it was asked, or, from another machine, when it arrived."""


_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[Envelope] = msgspec.msgpack.Decoder(Envelope)


def seal(request: AnyRequest, *, now: float, within: float, sender: str = "") -> Sealed:
    """Put a request into its envelope.

    Args:
        request: what is asked.
        now: [s] on the machine's monotonic clock.
        within: [s] for which the asker waits for the first answer.
        sender: key under which the asker is present.
    """
    begins, ends = isinstance(request, BEGINS), isinstance(request, ENDS)
    holds = min(within, FRESH) if begins else math.inf if ends else within
    body = _encode(Envelope(request, sender, now, holds, this_clock()))
    return Sealed(body, now + holds if begins or ends else 0.0)


def opened(body: bytes, who: str, now: float) -> Received:
    """Take a request out of its envelope.

    Args:
        body: as it came.
        who: is asked, for messages.
        now: [s] on the machine's monotonic clock.

    Raises:
        Garbled: it cannot be read.
        NoAnswer: it has expired: its asker has given up, or is about to.
    """
    try:
        envelope = _decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise Garbled(key="a caller", detail=str(error)) from None
    asked = envelope.asked if same_clock(envelope.clock) and envelope.asked <= now else now
    if not now - asked < envelope.holds:
        raise NoAnswer(key=who, seconds=envelope.holds)
    return Received(envelope.request, envelope.sender, asked)


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
