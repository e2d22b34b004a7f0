"""The one who attends a command at a key, from the side of the program that has called it.

The program passes each key on to the robot (`press`), at most `RATE` times a second: the robot ends the
command by itself when it has heard of none for `ATTENTION`. So a program that is killed, stopped or cut off
needs to do nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from robotree.vr.core.machine import ATTENTION

RATE: Final = 5.0
"""[1/s] Keys that are passed on at most: a key that is held repeats more often."""


class Attendance:
    """The keys of one person for one call at a time. On the event loop of the call."""

    def __init__(self, until: float = ATTENTION) -> None:
        """The call itself counts as the first key; it is attended for so long [s]."""
        self.until = until
        self._pass_on: Callable[[], None] | None = None
        self._last = 0.0

    def follow(self, pass_on: Callable[[], None]) -> None:
        """Take how a key is passed on to the robot, from now on."""
        self._pass_on, self._last = pass_on, asyncio.get_running_loop().time()

    def press(self) -> None:
        """Note that the person presses a key."""
        now = asyncio.get_running_loop().time()
        if self._pass_on is not None and now - self._last >= 1 / RATE:
            self._last = now
            self._pass_on()
