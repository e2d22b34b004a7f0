"""What a robot's code says, published soon, and not more than ten times a second."""

from __future__ import annotations

import asyncio
import contextlib

from robotree.vr.address import Address
from robotree.vr.errors import TransportError
from robotree.vr.requests import Heard, encode
from robotree.vr.running.heard import Log
from robotree.vr.transport import Transport

PAUSE = 0.1
"""[s] for which lines are collected."""


class Echo:
    """Publishes one log, on the event loop on which it was made."""

    def __init__(self, log: Log, address: Address, transport: Transport) -> None:
        """Publish every line from now on."""
        self._log, self._address, self._transport = log, address, transport
        self._loop = asyncio.get_running_loop()
        self._last = 0
        """Number of the line that was published last."""
        self._waiting = False
        log.on_line = self._new

    def _new(self) -> None:
        """Note a new line. From any thread."""
        if not self._waiting:
            self._waiting = True
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody wants to know
                self._loop.call_soon_threadsafe(self._later)

    def _later(self) -> None:
        self._loop.call_later(PAUSE, self._publish)

    def _publish(self) -> None:
        self._waiting = False
        lines = tuple(self._log.since(self._last))
        if lines:
            self._last = lines[-1].number
            with contextlib.suppress(TransportError):  # it is closed
                self._transport.publish(f"{self._address.key}/log", encode(Heard(lines=lines)))
