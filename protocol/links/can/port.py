"""One node's door to a bus: frames out in order of urgency, frames in, whatever python-can's interface is.

What every port does is here; the two kinds are in `opening.py`, which chooses.
"""

from __future__ import annotations

import asyncio
import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Protocol

import can

from robotree.files import forks

SEND_WITHIN = 1.0
"""[s] that a bus may refuse to take a frame before it counts as broken."""
MOST_ERRORS = 100
"""Failed receptions in a row that mean that the bus is broken; a single one can be a stray datagram."""


class PortUser(Protocol):
    """Lives behind a port."""

    def heard(self, message: can.Message) -> None:
        """A data frame came."""
        ...

    def room(self) -> None:
        """The bus took all that waited."""
        ...

    def broke(self, cause: str) -> None:
        """The bus is of no more use; told once, and nothing is told after it."""
        ...


class Port(ABC):
    """The base of all ports. The event loop's thread alone calls it."""

    def __init__(self, bus: can.BusABC, *, fd: bool) -> None:
        self.bus, self.fd = bus, fd
        self.user: PortUser | None = None
        """Must be set before the event loop runs again."""
        self._loop = asyncio.get_running_loop()
        self._open = True
        forks.owns(self)
        self._failures = 0

    def in_child(self) -> Iterable[int]:
        """See `forks.Owner`. Not every interface of python-can has a descriptor."""
        with contextlib.suppress(NotImplementedError, OSError, ValueError):
            return (self.bus.fileno(),)
        return ()

    @property
    @abstractmethod
    def congested(self) -> bool:
        """Whether so many wait that more had better wait where they can still be superseded."""

    @abstractmethod
    def send(self, arbitration_id: int, data: bytes, *, fd: bool) -> None:
        """Send a frame, or queue it. Never blocks, never raises.

        Args:
            arbitration_id: 29 bits.
            data: the data field, of a size that its format allows.
            fd: the format.
        """

    @abstractmethod
    def leave(self) -> asyncio.Future[None]:
        """Send what the bus still takes, and leave it; done when it is left. Never fails, may be repeated."""

    def _shut(self) -> None:
        """Shut the bus down and release it. May block.

        A pulled adapter takes no last word; python-can then forgets to close its descriptor, for which the
        system keeps the adapter's name. It is closed with the last reference.
        """
        bus: can.BusABC | None = vars(self).pop("bus", None)
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def _take(self, message: can.Message) -> None:
        self._failures = 0
        usual = not (message.is_error_frame or message.is_remote_frame)
        if usual and self._open and self.user is not None:
            self.user.heard(message)

    def _fail_to_receive(self, error: Exception) -> None:
        self._failures += 1
        if self._failures >= MOST_ERRORS:
            self._break(f"{MOST_ERRORS} receptions in a row failed, the last one because: {error}")

    def _break(self, cause: str) -> None:
        if self._open:
            self._open = False
            self._stop()
            if self.user is not None:
                self.user.broke(cause)

    @abstractmethod
    def _stop(self) -> None:
        """Hear the bus no more."""


def frame(arbitration_id: int, data: bytes, *, fd: bool) -> can.Message:
    """A data frame as python-can wants it."""
    return can.Message(
        arbitration_id=arbitration_id, data=data, is_fd=fd, bitrate_switch=fd, is_extended_id=True
    )
