"""Tells how a robot is: at every change, ten times a second while it works, else once a second."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from robotree.vr.errors import VrError
from robotree.vr.requests import State, encode
from robotree.vr.transport import Transport

QUICK = 0.1
"""[s] Least time between two states, and the period while a command runs."""
SLOW = 1.0
"""[s] Period while nothing happens."""


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

    async def run(self) -> None:
        """Publish until cancelled or until the transport is closed."""
        with contextlib.suppress(VrError):
            while True:
                self._changed.clear()
                state = self._state()
                self._transport.publish(self._key, encode(state))
                await asyncio.sleep(QUICK)
                if not state.busy:
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(self._changed.wait(), SLOW - QUICK)
