"""The sender of a message, and the effect that all services return: send a message."""

from __future__ import annotations

from collections.abc import Hashable

import msgspec

from robotree.protocol.messages import AnyMessage


class Peer(msgspec.Struct, frozen=True):
    """A component of a system on one of our links.

    System ids on two links may collide, so the link counts.
    """

    via: Hashable
    """The link it was heard on, as the caller names links; an `Endpoint` will do."""
    system: int
    component: int


class Send(msgspec.Struct, frozen=True):
    """Please send this message."""

    message: AnyMessage
    via: Hashable = None
    """The link to send it on; None: the service knows only one."""
