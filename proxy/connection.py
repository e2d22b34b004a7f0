"""The connection to one controller: opens a link, opens another when it ends, and runs the session over it.

Everything here runs on one event loop. Other threads call `soon`.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections.abc import Awaitable, Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import BadUrl, LinkClosed, LinkError, LocalProtocolError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Accept, Handler, Link
from robotree.protocol.links.loopback import Faults
from robotree.protocol.links.rejection import rejection
from robotree.protocol.links.security import UNSIGNED, LinkSecurity, SignerPair
from robotree.protocol.links.url import connect
from robotree.protocol.messages import AnyMessage
from robotree.protocol.services.peer import Send
from robotree.protocol.services.statustext import Sentence
from robotree.proxy.session import (
    SUPERVISOR_SYSTEM,
    ControllerSession,
    OnlineChanged,
    Redial,
    SessionEffect,
    SessionEvent,
)
from robotree.vr.running.runner import Runner, Threads

_log = logging.getLogger(__name__)

GRID = 0.05
"""[s] What is due within it is done together, at the end of it: so a process wakes up less often."""

SOUND = Faults()
"""Of a link that is as it should be."""

KEY_CHANGED = "its signing key was changed"
"""Why a link is closed at once: the next one finds the new key in our file."""

Dial = Callable[[str, Accept], Awaitable[Link]]
"""Opens a link, as `links.url.connect` does."""


@dataclass(slots=True)
class Backoff:
    """The waits before each attempt to reach a controller; `reset` after a success.

    The longest wait doubles up to a ceiling. Each wait is drawn evenly between half of it and all of it, so
    that a dozen proxies that lost one switch do not come back at the same moment.

    >>> backoff = Backoff(chance=random.Random(1))
    >>> [round(backoff.next_wait(), 2) for _ in range(6)]
    [0.06, 0.18, 0.35, 0.5, 1.2, 1.45]
    """

    chance: random.Random
    first: float = 0.1
    """[s] longest first wait."""
    ceiling: float = 2.0
    """[s] longest wait of all: a controller that was switched on is found within it."""
    attempts: int = field(default=0, init=False)
    """Failures since the last success."""

    def next_wait(self) -> float:
        """Count one failure and return how long to wait [s] before the next attempt."""
        longest = min(self.ceiling, self.first * 2.0 ** min(self.attempts, 30))
        self.attempts += 1
        return longest * (0.5 + 0.5 * self.chance.random())

    def reset(self) -> None:
        """An attempt succeeded."""
        self.attempts = 0


class Connection:
    """Keeps one session connected to the controller at one address.

    Args:
        url: where it listens, such as `tcp:127.0.0.1:5760`.
        session: decides what is sent.
        on_event: called on the loop with each event of the session.
        on_message: called on the loop with each message of the controller that the session has taken.
        dial: opens a link.
        chance: for the jitter of the waits between attempts.
        security: the keys of our links.
        runner: its clock, and what the threads of commands wait in.
    """

    def __init__(
        self,
        url: str,
        session: ControllerSession,
        *,
        on_event: Callable[[SessionEvent], None],
        on_message: Callable[[AnyMessage], None] | None = None,
        dial: Dial = connect,
        chance: random.Random | None = None,
        security: LinkSecurity = UNSIGNED,
        runner: Runner | None = None,
    ) -> None:
        self.url = url
        self.runner: Runner = runner or Threads()
        self.session = session
        self._security = security
        self._signer_pair = SignerPair(signer=None, verifier=None)
        self._signed = self._believed = self._refused = 0
        self._rejection = ""
        self._on_event = on_event
        self._on_message = on_message
        self._dial = dial
        self._backoff = Backoff(chance or random.Random())
        self._faults, self._chance = SOUND, chance or random.Random()
        """What a drill does to messages on their way; nothing: the link is as it should be."""
        self._told_offline = False
        """Whether the log has the entry that it is offline."""
        self._endpoint: Endpoint | None = None
        self._heard = False
        """Whether the latest bytes had a frame that the session took."""
        self._acted = False
        """Whether anything followed from it; else nothing is due earlier than before."""
        self._failed: asyncio.Future[None]
        """Of the running connection: what a tick has raised."""
        self._ticking: asyncio.TimerHandle | None = None
        self._tick_due = math.inf
        """[s] When the next tick is due, as it was planned."""
        self._ticked_at = -math.inf
        """[s] When the last one was."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._awaited: list[tuple[type[Any], float, Callable[[], None]]] = []
        """Which kind of message is waited for, heard after which moment [s], and how to wake who waits."""

    def disturb(self, faults: Faults) -> None:
        """Do this to each message from now on, both ways, as a bad link would. On the loop.

        What has been delayed before still comes. While the link is as it should be (`Faults()`), nothing here
        costs anything.
        """
        self._faults = SOUND if faults == SOUND else faults

    def _disturbed(self, deliver: Callable[[], None]) -> None:
        """Deliver something as the faults let it."""
        if self._loop is not None and self._chance.random() >= self._faults.loss:
            self._loop.call_later(self._faults.delay + self._faults.jitter * self._chance.random(), deliver)

    def now(self) -> float:
        """The time [s] on the clock of this connection."""
        return self.runner.now()

    async def run(self) -> None:
        """Keep the session connected until cancelled.

        Raises:
            BadUrl: the address means nothing; trying again would not help.
        """
        self._loop = asyncio.get_running_loop()
        self._failed = self._loop.create_future()
        dialling = self._loop.create_task(self._dial_loop())
        self._plan_tick()
        try:
            done, _ = await asyncio.wait([dialling, self._failed], return_when=asyncio.FIRST_COMPLETED)
            for each in done:
                each.result()
        finally:
            self.perform(self.session.release_claim())
            dialling.cancel()
            await asyncio.gather(dialling, return_exceptions=True)
            self._loop = None
            self._cancel_tick()
            self.perform(self.session.closed("its proxy has ended"))

    def soon(self, action: Callable[[], None]) -> None:
        """Call something on the loop, from any thread; at once when this is the loop's own thread."""
        loop = self._loop
        if loop is None or _running_loop() is loop:
            action()
        else:
            loop.call_soon_threadsafe(action)

    @contextmanager
    def awaiting(self, kind: type[Any], since: float, wake: Callable[[], None]) -> Generator[None]:
        """Wake a thread when a message is heard, or when the controller goes online or offline.

        Args:
            kind: of message.
            since: [s] on this connection's clock, after which it must be heard.
            wake: wakes the thread. What was heard before this began wakes nobody: look first.
        """
        entry = (kind, since, wake)
        self._awaited.append(entry)
        try:
            yield
        finally:
            self._awaited.remove(entry)

    def perform(self, effects: Sequence[SessionEffect]) -> None:
        """Carry out what the session asks for and pass its events on. On the loop only."""
        self._carry_out(effects)
        self._plan_tick()

    # -- inside ------------------------------------------------------------------------------------

    def _carry_out(self, effects: Sequence[SessionEffect]) -> None:
        for effect in effects:
            match effect:
                case Send(message=message):
                    self._send(message)
                case Redial(trouble=trouble):
                    _log.warning("%s: %s; dialling again", self.url, trouble)
                    if self._endpoint is not None:
                        self._endpoint.link.close()
                case Sentence(text=text):
                    _log.info("%s says: %s", self.url, text)
                    self._on_event(effect)
                case OnlineChanged(online=online):
                    self._on_event(effect)  # first: who reads the log finds the robot as it says
                    self._note(online=online)
                    for _, _, wake in tuple(self._awaited):
                        wake()
                case _:
                    self._on_event(effect)

    async def _dial_loop(self) -> None:
        while True:
            trouble = await self._run_link()
            self.perform(self.session.closed(trouble))
            await asyncio.sleep(self._backoff.next_wait())

    async def _run_link(self) -> str:
        """Open one link and use it to its end; returns why it ended, as a clause."""
        ended: asyncio.Future[LinkError] = asyncio.get_running_loop().create_future()
        endpoints: list[Endpoint] = []

        def accept(link: Link) -> Handler:
            self._signer_pair = self._security.signer_pair(link.controller)
            self._signed = self._believed = self._refused = 0
            self._rejection = ""
            endpoint = Endpoint(
                link,
                system=SUPERVISOR_SYSTEM,
                component=self.session.component,
                on_frame=self._hear,
                on_heard=self._listened,
                on_closed=lambda reason: None if ended.done() else ended.set_result(reason),
                **self._signer_pair,
            )
            endpoints.append(endpoint)
            return endpoint

        try:
            link = await self._dial(self.url, accept)
        except BadUrl:
            raise
        except LinkError as error:
            return f"its controller cannot be reached: {error}"
        self._endpoint = endpoints[0]
        try:
            self.perform(self.session.opened(self.now()))
            reason = await ended
        finally:
            self._endpoint = None
            link.close()
        if isinstance(reason, LinkClosed) and reason.by_us and self.session.rejection:
            return self.session.rejection
        if isinstance(reason, LinkClosed):
            return f"its controller has closed the link {self.url}"
        return f"the link to its controller is broken: {reason}"

    def _plan_tick(self) -> None:
        """Have the session's `tick` called when it is due."""
        loop, due, now = self._loop, self.session.due, self.now()
        if now < due < math.inf:
            due = max(math.ceil(due / GRID) * GRID, due)
        elif due <= now == self._ticked_at:  # it has just been asked
            due = now + GRID
        if loop is not None and due < self._tick_due:
            self._cancel_tick()
            self._tick_due = due
            self._ticking = loop.call_later(max(due - now, 0.0), self._tick)

    def _cancel_tick(self) -> None:
        if self._ticking is not None:
            self._ticking.cancel()
        self._ticking, self._tick_due = None, math.inf

    def _tick(self) -> None:
        self._ticking, self._tick_due = None, math.inf
        self._ticked_at = self.now()
        try:
            self.perform(self.session.tick(self._ticked_at))
        except Exception as error:  # noqa: BLE001 # raised by `run`
            if not self._failed.done():
                self._failed.set_exception(error)

    def _listened(self) -> None:
        """Some bytes have come, and their frames were heard."""
        if self._endpoint is not None and (not self._heard or self.session.rejection):
            self._look_at_rejection(self._endpoint)
        self._heard = False
        if self._acted:
            self._acted = False
            self._plan_tick()

    def _look_at_rejection(self, endpoint: Endpoint) -> None:
        rejection = self._rejection_of(endpoint)
        if rejection == self.session.rejection:
            return
        before, self.session.rejection = self.session.rejection, rejection
        self.perform(self.session.tick(self.now()))
        if rejection == KEY_CHANGED:
            endpoint.link.close()  # logged as the reason when the robot is offline
        elif rejection and not before:
            _log.warning("%s: %s", self.url, rejection)

    def _rejection_of(self, endpoint: Endpoint) -> str:
        """Why the latest frames on the present link were rejected; empty: they were not, or nothing came."""
        heard = endpoint.statistics
        if heard.refused and self._security.renewed(endpoint.link.controller, self._signer_pair):
            return KEY_CHANGED
        believed, refused = heard.received - self._signed, heard.refused + self._signed
        if believed > self._believed:
            self._rejection = ""
        elif refused > self._refused:
            self._rejection = rejection(self._signer_pair["verifier"], keyless=self._signed)
        self._believed, self._refused = believed, refused
        return self._rejection

    def _send(self, message: AnyMessage) -> None:
        if self._faults is SOUND:
            self._send_now(message)
        else:
            self._disturbed(partial(self._send_now, message))

    def _send_now(self, message: AnyMessage) -> None:
        if self._endpoint is None:
            return
        try:
            self._endpoint.send(message, component=self.session.component)
        except LocalProtocolError:  # our own mistake; its goal ends as unanswered
            _log.exception("%s: a message could not be sent", self.url)

    def _hear(self, frame: Frame) -> None:
        if self._faults is SOUND:
            self._hear_now(frame)
        else:
            self._disturbed(partial(self._hear_late, frame))

    def _hear_late(self, frame: Frame) -> None:
        self._hear_now(frame)
        self._listened()

    def _hear_now(self, frame: Frame) -> None:
        if frame.signature and self._signer_pair["verifier"] is None:
            # A controller that signs obeys only signed frames, and this link has no key: the robot could not
            # be stopped from here, so it must not be shown as online.
            self._signed += 1
            return
        self._heard = True
        if effects := self.session.receive(frame, self.runner.now()):
            self._acted = True
            self._carry_out(effects)
        if self._on_message is not None and frame.component == self.session.controller.component:
            self._on_message(frame.message)
        if self._awaited:
            for kind, since, wake in tuple(self._awaited):  # threads enter and leave meanwhile
                if self.session.twin.after(kind, since) is not None:
                    wake()

    def _note(self, *, online: bool) -> None:
        if online:
            self._backoff.reset()
            _log.log(logging.WARNING if self._told_offline else logging.INFO, "%s: online", self.url)
            self._told_offline = False
        else:
            self._told_offline = True
            _log.warning("%s: offline, %s", self.url, self.session.trouble)


def _running_loop() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None
