"""A robot's own hooks, called so that no author can hold up the event loop that all robots of a host share.

Proxies are part of this project and their hooks are quick by contract, so they are called directly. What the
author of a virtual robot overrides runs in separate threads: its readings, which are then one sample old,
and one after the other, as they were asked for, what belongs to stops and their releases.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
import math
import numbers
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from functools import partial
from typing import TypeVar

from robotree.files import forks
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.errors import VrError, words_of
from robotree.vr.running.heard import Voice, speaking
from robotree.vr.running.page_trace import begin_of, page_lines, trace
from robotree.vr.running.runner import Runner, SerialWorker

_T = TypeVar("_T")
_log = logging.getLogger(__name__)


UNCONFIRMED = "its controller has not confirmed it"
"""The reason, as a clause, when a hook has begun and nothing more is heard."""

STILL_STOPPING = "its safe_stop has not ended"
"""The reason shown while an author's hook still carries out a stop: nothing may begin meanwhile."""

Hook = Callable[[], Awaitable[None] | None]
"""A hook with its arguments."""


class HookFailed(Exception):
    """An author's hook has raised something, which has been logged; the text describes it as a clause."""


class Confirming:
    """A hook that has begun, until the controller behind the robot has confirmed it."""

    def __init__(self, name: str, hook: Hook, *, late: str = UNCONFIRMED) -> None:
        """Call the hook, whatever it raises.

        Args:
            name: of it, for the log.
            hook: the hook.
            late: what it means that there is no confirmation in time, as a clause.
        """
        self._name, self._late = name, late
        self._confirmation: Awaitable[None] | None = None
        self._failed = False
        try:
            self._confirmation = _called(hook)
        except Exception:  # noqa: BLE001 # the boundary to an author's code
            _log.exception("%s failed", name)
            self._failed = True

    async def doubt(self, within: float) -> str:
        """Wait until it is confirmed, for `within` [s] at most.

        Returns:
            Why it is not, as a clause; empty: it is.

        Raises:
            VrError: it has been refused for good.
        """
        if self._failed or self._confirmation is None:
            return UNCONFIRMED if self._failed else ""
        confirmation = asyncio.ensure_future(self._confirmation)
        try:
            await asyncio.wait([confirmation], timeout=within)
        finally:
            confirmation.cancel()
        if not confirmation.done() or confirmation.cancelled():
            return self._late
        error = confirmation.exception()
        if isinstance(error, VrError):
            raise error
        if isinstance(error, HookFailed):
            return str(error)
        if error is not None:
            _log.error("%s failed", self._name, exc_info=error)
        return "" if error is None else UNCONFIRMED


class Hooks:
    """The hooks of one robot."""

    def __init__(self, robot: Robot, runner: Runner, voice: Voice) -> None:
        """Take the robot whose hooks these are, what runs them, and what takes their output."""
        self._voice = voice
        self._robot, self._runner = robot, runner
        self._latest: dict[str, float] = {}
        self._sampling = threading.Lock()
        self._faults: dict[str, str] = {}
        self._turns = SerialWorker(runner, f"{robot.name} hook")
        self._latest_turn: Future[bool] | None = None
        """The newest of the author's hooks for stops and releases."""
        self._stopping: Future[bool] | None = None
        """The newest of those that stop something."""
        self._resuming: Future[bool] | None = None
        """The newest of those that release something."""
        self._reason = "protective stop"

    def become(self, robot: Robot) -> None:
        """Call the hooks of another page of the robot from now on."""
        self._robot, self._faults = robot, {}

    @property
    def faults(self) -> tuple[str, ...]:
        """How hooks of the author failed when they were called last, as sentences; empty: none did."""
        return tuple(self._faults.values())

    def _note(self, hook: str, fault: str) -> None:
        """Note that a hook has failed, or with an empty text that it works; enter it in the robot's log."""
        before = self._faults.get(hook, "")
        if fault:
            self._faults[hook] = fault
            if fault != before:
                self._voice("error", fault)
        elif before:
            self._faults.pop(hook, None)

    def _fault(self, hook: str, error: Exception) -> str:
        """Return a sentence on what a hook has raised, with the line of the page."""
        written = inspect.unwrap(getattr(type(self._robot), hook))
        lines = page_lines(error, written.__code__.co_filename)
        where = lines[-1].place if lines else begin_of(written)
        return f"{hook} failed: {words_of(error)} ({where})"

    @property
    def own_readings(self) -> bool:
        """Whether the robot reads anything that may change by itself."""
        return type(self._robot).readings is not Robot.readings

    def readings(self) -> dict[str, float]:
        """Return the latest readings, numbers only."""
        if not self._foreign("readings"):
            self._sample()
        elif self._sampling.acquire(blocking=False):
            self._runner.spawn(self._sample_and_release, f"{self._robot.name} hook")
        return self._latest

    def safe_stop(self, reason: str) -> Confirming:
        """Let the robot take part in a protective stop, from now on."""
        self._reason = reason
        if self._resuming is not None:
            self._resuming.cancel()  # if it has not begun
        hook = partial(self._robot.safe_stop, reason)
        if not self._foreign("safe_stop"):
            return Confirming(f"{self._robot.name}.safe_stop", hook)
        self._stopping = self._in_turn("safe_stop", hook)
        return self._confirming("safe_stop", _ended(self._stopping, "safe_stop"))

    async def has_stopped(self, within: float) -> bool:
        """Wait until the author's hooks that stop the robot have ended, for `within` [s] at most."""
        if self._stopping is None or self._stopping.done():
            return True
        ended = asyncio.wrap_future(self._stopping)
        return bool((await asyncio.wait([asyncio.shield(ended)], timeout=within))[0])

    def resume(self) -> Confirming:
        """Let the robot take part in the release of a stop, from now on.

        Where an author's hook is not confirmed the robot stays stopped: its `safe_stop` is called once more.
        """
        if not self._foreign("resume"):
            return Confirming(f"{self._robot.name}.resume", self._robot.resume)
        self._resuming = self._in_turn("resume", self._robot.resume)
        return self._confirming("resume", self._released(self._resuming))

    def _confirming(self, name: str, ended: Awaitable[None]) -> Confirming:
        return Confirming(f"{self._robot.name}.{name}", lambda: ended, late=f"its {name} has not ended")

    async def _released(self, turn: Future[bool]) -> None:
        try:
            await _ended(turn, "resume")
        except (asyncio.CancelledError, HookFailed):
            turn.cancel()  # if it has not begun
            if self._latest_turn is turn:  # nothing newer decides
                self._in_turn("safe_stop", partial(self._robot.safe_stop, self._reason))
            raise

    def _in_turn(self, name: str, hook: Hook) -> Future[bool]:
        self._latest_turn = self._turns.submit(partial(self._went_well, name, hook))
        return self._latest_turn

    def _foreign(self, name: str) -> bool:
        """Whether the author of a virtual robot has written this hook."""
        return isinstance(self._robot, VirtualRobot) and getattr(type(self._robot), name) is not getattr(
            Robot, name
        )

    def _sample_and_release(self) -> None:
        try:
            self._sample()
        finally:
            self._sampling.release()

    def _sample(self) -> None:
        name = f"{self._robot.name}.readings"
        try:
            with speaking(self._voice):
                readings = _called(self._robot.readings)
            taken = {str(name): float(value) for name, value in readings.items() if _is_number(value)}
        except Exception as error:  # noqa: BLE001 # the boundary to an author's code
            if "readings" not in self._faults:
                _log.error("%s failed; this is said once\n%s", name, trace(error))
            self._note("readings", self._fault("readings", error))
            self._latest = {}
            return
        self._latest = taken
        wrong = [f"{name!r} is {value!r}" for name, value in readings.items() if not _is_number(value)]
        complaint = "readings gives what is no number, which is left out"
        where = begin_of(self._robot.readings) if wrong else ""
        self._note("readings", f"{complaint}: {', '.join(wrong)} ({where})" if wrong else "")

    def _went_well(self, name: str, hook: Hook) -> bool:
        """Run an author's hook in its thread; return whether it has ended as it should."""
        label = f"{self._robot.name}.{name}"
        try:
            with speaking(self._voice):
                left = _called(hook)
        except Exception as error:  # noqa: BLE001 # the boundary to an author's code
            _log.error("%s failed\n%s", label, trace(error))
            self._note(name, self._fault(name, error))
            return False
        if inspect.iscoroutine(left):
            left.close()
        if inspect.isawaitable(left):
            complaint = "returns something to wait for: what it does is to be done when it returns"
            _log.error("%s %s", label, complaint)
            self._note(name, f"{name} {complaint} ({begin_of(getattr(self._robot, name))})")
            return False
        self._note(name, "")
        return True


def _called(hook: Callable[[], _T]) -> _T:
    """Return what an author's hook returns, or raise what it raises."""
    try:
        return hook()
    finally:
        forks.expect_parent()


def _is_number(value: object) -> bool:
    return isinstance(value, numbers.Real) and not math.isinf(value)


async def _ended(turn: Future[bool], name: str) -> None:
    """Wait for the end of an author's hook; to wait no longer ends nothing.

    Raises:
        HookFailed: it did not end well.
    """
    if not await asyncio.shield(asyncio.wrap_future(turn)):
        raise HookFailed(f"its {name} failed")
