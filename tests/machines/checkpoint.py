"""The law of the checkpoint: what is encoded, decoded and goes on behaves as if nothing had happened.

The checkpoint is the state of a `RobotCore`, and so each machine that plays with a part of it (lease granted,
lease held, slots, calls, stop) replaces that part by `decoded` at random moments. The other machines have
none: the table of a lookup service is soft state, which its robots bring back after a restart; what a
controller keeps of claims and goals is its own, on the other side of the wire; the facts of a script live as
long as its run; sessions and the firmware begin anew.
"""

from __future__ import annotations

from typing import TypeVar

import msgspec

S = TypeVar("S", bound=msgspec.Struct)


def decoded(state: S) -> S:
    """Return what a state is after it has been written as MessagePack and read again."""
    return msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=type(state))
