"""Tells how a robot is: at every change, ten times a second while it works, else once a second."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable

from robotree.vr.errors import TransportError
from robotree.vr.requests import State, encode
from robotree.vr.transport import Transport

QUICK = 0.1
"""[s] Least time between two states, and the period while a command runs."""
SLOW = 1.0
"""[s] Period while nothing happens."""


_log = logging.getLogger(__name__)


class StateNews:
    """Publishes one robot's state under its key + `/state`."""

    def __init__(self, transport: Transport, key: str, state: Callable[[], State]) -> None:
        """Prepare; `run` publishes.

        Args:
            transport: where.
            key: of the robot.
            state: returns how it is now; quick.
        """
        self._transport, self._key, self._state = transport, f"{key}/state", state
        self._changed = asyncio.Event()

    def changed(self) -> None:
        """Note that there is something new to tell."""
        self._changed.set()

    def _publish(self) -> bool:
        """Tell how it is now; return whether it is busy."""
        try:
            state = self._state()
            self._transport.publish(self._key, encode(state))
        except TransportError:
            raise
        except Exception:  # noqa: BLE001 # an author's code may be behind it
            _log.exception("%s has no state to tell", self._key)
            return False
        return bool(state.busy)

    async def run(self) -> None:
        """Publish until cancelled or until the transport is closed."""
        with contextlib.suppress(TransportError):
            while True:
                self._changed.clear()
                busy = self._publish()
                await asyncio.sleep(QUICK)
                if not busy:
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(SLOW - QUICK):
                            await self._changed.wait()
