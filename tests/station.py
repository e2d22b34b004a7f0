"""A ground station for tests: one MAVLink client on a real link, which sends what the test wants."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from itertools import count
from typing import Any, Self

from robotree.protocol import Endpoint, Frame
from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import UNSIGNED
from robotree.protocol.links.url import connect
from robotree.protocol.messages import AnyMessage, Heartbeat, MavAutopilot, MavState, MavType, Ping
from robotree.protocol.services.picture import Picture, PictureReceiver
from robotree.protocol.services.statustext import StatustextReceiver
from tests.waiting import PATIENCE

BEAT = Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)


class Station:
    """One client.

    Args:
        system: its MAVLink system id.
        component: its component id.
        security: has `signer_pair`: the keys of its link.
        greets: whether it sends a heartbeat as soon as it is connected.
    """

    def __init__(
        self, system: int = 255, component: int = 190, security: Any = UNSIGNED, *, greets: bool = True
    ) -> None:
        self.system, self.component, self.security = system, component, security
        self.heard: list[AnyMessage] = []
        self.sentences: list[str] = []
        self.pictures: list[Picture] = []
        self.ended: asyncio.Future[LinkError] = asyncio.get_running_loop().create_future()
        self._greets = greets
        self._looked_at = 0
        self._texts, self._pieces = StatustextReceiver(), PictureReceiver()
        self._news = asyncio.Event()
        self._numbers = count(1)

    async def dial(self, address: str) -> Self:
        self.link = await connect(address, self._accept)
        if self._greets:
            self.say(BEAT)
        return self

    def say(self, message: AnyMessage) -> None:
        self.endpoint.send(message)

    async def until(self, happened: Callable[[], object]) -> None:
        """Wait until something is the case after a frame that was heard."""
        async with asyncio.timeout(PATIENCE):
            while not happened():
                self._news.clear()
                await self._news.wait()

    async def told(self, kind: type[AnyMessage], **fields: object) -> AnyMessage:
        """A message of a kind with these fields, also one that was heard before."""

        def found() -> list[AnyMessage]:
            kinds = (message for message in self.heard if isinstance(message, kind))
            return [each for each in kinds if all(getattr(each, k) == v for k, v in fields.items())]

        await self.until(found)
        return found()[0]

    async def next(self, wanted: Callable[[Any], bool]) -> Any:
        """The next message that is wanted; those before it are not looked at again."""
        while True:
            await self.until(lambda: self._looked_at < len(self.heard))
            message = self.heard[self._looked_at]
            self._looked_at += 1
            if wanted(message):
                return message

    async def picture(self) -> Picture:
        await self.until(lambda: self.pictures)
        return self.pictures.pop(0)

    async def ping(self) -> None:
        """Ask, and wait for the answer: then all that was said before was heard, too."""
        number = next(self._numbers)
        self.say(Ping(0, number))
        await self.told(Ping, seq=number, target_system=self.system)

    @property
    def refused(self) -> int:
        """Frames without the right signature."""
        return self.endpoint.statistics.refused

    def _accept(self, link: Link) -> Endpoint:
        self.endpoint = Endpoint(
            link,
            system=self.system,
            component=self.component,
            on_frame=self._hear,
            on_closed=self._closed,
            **self.security.signer_pair(link.controller),
        )
        return self.endpoint

    def _closed(self, reason: LinkError) -> None:
        if not self.ended.done():
            self.ended.set_result(reason)

    def _hear(self, frame: Frame) -> None:
        self.heard.append(frame.message)
        self.sentences += [one.text for one in self._texts.receive(frame, None, 0.0)]
        self.pictures += self._pieces.receive(frame, None)
        self._news.set()
