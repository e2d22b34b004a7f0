"""The shell around a session: opens links to one controller, again and again, and carries bytes and moments.

Everything here runs on one event loop. Other threads hand their wishes in through `soon`.
"""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Awaitable, Callable, Sequence

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import BadUrl, LinkClosed, LinkError, LocalProtocolError
from robotree.protocol.frame import Frame
from robotree.protocol.links.disbelief import disbelief
from robotree.protocol.links.link import Accept, Handler, Link
from robotree.protocol.links.security import UNSIGNED, Sealing, Seals
from robotree.protocol.links.url import connect
from robotree.protocol.messages import AnyMessage
from robotree.protocol.services.peer import Send
from robotree.protocol.services.statustext import Sentence
from robotree.proxy.backoff import Backoff
from robotree.proxy.session import SUPERVISOR_SYSTEM, Effect, Event, OnlineChanged, Redial, Session

_log = logging.getLogger(__name__)

TICK = 0.1
"""[s] between two looks at the clock."""

KEY_CHANGED = "its signing key was changed"
"""Why a link is given up at once: the next one finds the new key in our file."""

Dial = Callable[[str, Accept], Awaitable[Link]]
"""Opens a link, as `links.url.connect` does."""


class Connection:
    """Stays in conversation with the controller at one address.

    Args:
        url: where it listens, such as `tcp:127.0.0.1:5760`.
        session: the conversation.
        on_event: told everything the session has to tell, on the loop.
        dial: opens a link.
        chance: for the jitter of the waits between attempts.
        security: the keys of our links.
    """

    def __init__(
        self,
        url: str,
        session: Session,
        *,
        on_event: Callable[[Event], None],
        dial: Dial = connect,
        chance: random.Random | None = None,
        security: Sealing = UNSIGNED,
    ) -> None:
        self.url = url
        self.session = session
        self._security = security
        self._seals = Seals(signer=None, verifier=None)
        self._signed = self._believed = self._refused = 0
        self._doubt = ""
        self._on_event = on_event
        self._dial = dial
        self._backoff = Backoff(chance or random.Random())
        self._missed = False
        """Whether people were told that it is offline."""
        self._endpoint: Endpoint | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    def now(self) -> float:
        """The moment [s] on the clock that all of this connection's moments are read from."""
        return time.monotonic()

    async def run(self) -> None:
        """Keep the conversation up until cancelled.

        Raises:
            BadUrl: the address means nothing; trying again would not help.
        """
        self._loop = asyncio.get_running_loop()
        work = [self._loop.create_task(each) for each in (self._dial_on(), self._tick())]
        try:
            done, _ = await asyncio.wait(work, return_when=asyncio.FIRST_COMPLETED)
            for each in done:
                each.result()
        finally:
            self.perform(self.session.farewell())
            for each in work:
                each.cancel()
            await asyncio.gather(*work, return_exceptions=True)
            self._loop = None
            self.perform(self.session.closed("its proxy has ended"))

    def soon(self, wish: Callable[[], None]) -> None:
        """Have something done on the loop, from any thread; at once when this is the loop's own."""
        loop = self._loop
        if loop is None or _running_loop() is loop:
            wish()
        else:
            loop.call_soon_threadsafe(wish)

    def perform(self, effects: Sequence[Effect]) -> None:
        """Carry out what the session asks for and tell what it has to tell. On the loop only."""
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
                    self._note(online=online)
                    self._on_event(effect)
                case _:
                    self._on_event(effect)

    # -- inside ------------------------------------------------------------------------------------

    async def _dial_on(self) -> None:
        while True:
            trouble = await self._converse()
            self.perform(self.session.closed(trouble))
            await asyncio.sleep(self._backoff.next_wait())

    async def _converse(self) -> str:
        """Open one link and use it to its end; returns why it ended, as a clause."""
        ended: asyncio.Future[LinkError] = asyncio.get_running_loop().create_future()
        endpoints: list[Endpoint] = []

        def accept(link: Link) -> Handler:
            self._seals = self._security.seals(link.address)
            self._signed = self._believed = self._refused = 0
            self._doubt = ""
            endpoint = Endpoint(
                link,
                system=SUPERVISOR_SYSTEM,
                component=self.session.component,
                on_frame=self._hear,
                on_closed=lambda reason: None if ended.done() else ended.set_result(reason),
                **self._seals,
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
        if isinstance(reason, LinkClosed) and reason.by_us and self.session.disbelief:
            return self.session.disbelief
        if isinstance(reason, LinkClosed):
            return f"its controller has closed the link {self.url}"
        return f"the link to its controller is broken: {reason}"

    async def _tick(self) -> None:
        while True:
            if self._endpoint is not None:
                doubt = self._disbelief(self._endpoint)
                if doubt and not self.session.disbelief:
                    _log.warning("%s: %s", self.url, doubt)
                self.session.disbelief = doubt
                if doubt == KEY_CHANGED:
                    self._endpoint.link.close()
            self.perform(self.session.tick(self.now()))
            await asyncio.sleep(TICK)

    def _disbelief(self, endpoint: Endpoint) -> str:
        """Why what came last over the present link is not heard; empty: it is, or nothing came."""
        heard = endpoint.statistics
        if heard.refused and self._security.renewed(endpoint.link.address, self._seals):
            return KEY_CHANGED
        believed, refused = heard.received - self._signed, heard.refused + self._signed
        if believed > self._believed:
            self._doubt = ""
        elif refused > self._refused:
            self._doubt = disbelief(self._seals["verifier"], keyless=self._signed)
        self._believed, self._refused = believed, refused
        return self._doubt

    def _send(self, message: AnyMessage) -> None:
        if self._endpoint is None:
            return
        try:
            self._endpoint.send(message, component=self.session.component)
        except LocalProtocolError:  # our own mistake; the goal will be told silent
            _log.exception("%s: a message could not be sent", self.url)

    def _hear(self, frame: Frame) -> None:
        if frame.signed and self._seals["verifier"] is None:
            # Who signs obeys nobody without the key: a robot that cannot be stopped must not look free.
            self._signed += 1
            return
        self.perform(self.session.hear(frame, self.now()))

    def _note(self, *, online: bool) -> None:
        if online:
            self._backoff.reset()
            _log.log(logging.WARNING if self._missed else logging.INFO, "%s: online", self.url)
            self._missed = False
        else:
            self._missed = True
            _log.warning("%s: offline, %s", self.url, self.session.trouble)


def _running_loop() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None
