"""A robot's own hooks, called so that no author can hold up the event loop that all robots of a host share.

Proxies are part of this project and their hooks are quick by contract, so they are called directly. What the
author of a virtual robot overrides runs in a thread of its own; its readings are then one sample old.
"""

from __future__ import annotations

import asyncio
import logging
import math
import threading
from collections.abc import Awaitable, Callable
from typing import Any

from robotree.vr.errors import VrError
from robotree.vr.robot import Robot
from robotree.vr.virtual_robot import VirtualRobot

_log = logging.getLogger(__name__)


class Confirming:
    """What a hook has begun, until what stands behind the robot has confirmed it."""

    def __init__(self, what: str) -> None:
        """Prepare for the hook that is called `what`; until it begins there is nothing to wait for."""
        self.what = what
        self._confirmation: Awaitable[None] | None = None
        self._failed = False

    def begin(self, hook: Callable[[], Awaitable[None] | None]) -> None:
        """Call the hook, whatever it raises."""
        try:
            self._confirmation = hook()
        except Exception:  # noqa: BLE001 # the last fence around an author's code
            _log.exception("%s failed", self.what)
            self._failed = True

    async def confirmed(self, within: float) -> bool:
        """Wait until it is confirmed, for `within` [s] at most; return whether it is.

        Raises:
            VrError: it has been refused for good.
        """
        if self._failed or self._confirmation is None:
            return not self._failed
        confirmation = asyncio.ensure_future(self._confirmation)
        try:
            await asyncio.wait([confirmation], timeout=within)
        finally:
            confirmation.cancel()
        if not confirmation.done() or confirmation.cancelled():
            return False
        error = confirmation.exception()
        if isinstance(error, VrError):
            raise error
        if error is not None:
            _log.error("%s failed", self.what, exc_info=error)
        return error is None


class Hooks:
    """The hooks of one robot."""

    def __init__(self, robot: Robot) -> None:
        """Take the robot whose hooks are meant."""
        self._robot = robot
        self._latest: dict[str, float] = {}
        self._sampling = threading.Lock()
        self._complained = False

    def readings(self) -> dict[str, float]:
        """Return the latest readings, numbers only."""
        if not self._foreign("readings"):
            self._sample()
        elif self._sampling.acquire(blocking=False):
            self._aside(self._sample_and_release)
        return self._latest

    def safe_stop(self, reason: str) -> Confirming:
        """Let the robot take part in a protective stop, from now on."""
        return self._call("safe_stop", reason)

    def resume(self) -> Confirming:
        """Let the robot take part in the release of a stop, from now on."""
        return self._call("resume")

    def _call(self, name: str, *arguments: Any) -> Confirming:
        def hook() -> Awaitable[None] | None:
            begun: Awaitable[None] | None = getattr(self._robot, name)(*arguments)
            return begun

        confirming = Confirming(f"{self._robot.name}.{name}")
        if self._foreign(name):  # nobody waits for what an author does
            self._aside(lambda: Confirming(confirming.what).begin(hook))
        else:
            confirming.begin(hook)
        return confirming

    def _foreign(self, name: str) -> bool:
        """Whether the author of a virtual robot has written this hook."""
        return isinstance(self._robot, VirtualRobot) and getattr(type(self._robot), name) is not getattr(
            Robot, name
        )

    def _aside(self, work: Callable[[], object]) -> None:
        threading.Thread(target=work, name=f"{self._robot.name} hook", daemon=True).start()

    def _sample_and_release(self) -> None:
        try:
            self._sample()
        finally:
            self._sampling.release()

    def _sample(self) -> None:
        try:
            readings = self._robot.readings()
            self._latest = {str(name): float(value) for name, value in readings.items() if _is_number(value)}
        except Exception:  # noqa: BLE001 # the last fence around an author's code
            if not self._complained:
                _log.exception("%s.readings failed; this is said once", self._robot.name)
            self._complained, self._latest = True, {}


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not math.isinf(value)
