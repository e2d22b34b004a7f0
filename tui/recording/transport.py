"""The network of a recorded realm: whoever looks through it sees the realm as it was at one moment.

A `RealmClient` on it answers all questions about robots, views and logs. Nobody can be commanded.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from functools import partial

from robotree.tui.recording.playback import RECORDED, Playback, view_address, view_listing
from robotree.tui.recording.tape import Content, RecordedEnd, RecordedLine, RecordedPicture, RecordedState
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.base.envelope import read_envelope
from robotree.vr.base.errors import Unreachable, VrError
from robotree.vr.base.pattern import Handlers
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.presence import Presence
from robotree.vr.base.principal import Credentials
from robotree.vr.base.requests import (
    AnyRequest,
    Describe,
    Described,
    DescribeHost,
    DescribeView,
    Found,
    History,
    HostDescribed,
    Listed,
    Logged,
    LogLines,
    Look,
    Picture,
    Published,
    Query,
    Raised,
    ReadHistory,
    ReadLog,
    Reply,
    Unlisted,
    encode,
)
from robotree.vr.base.transport import CutOffHandler, OnReply, Registration, SampleHandler, TakeRequest

LOOKUP = Address("lookup", "recording", "recorded")
"""Lists who was free at the moment."""

TERM = 60.0
"""[s] that is left of every lease on a listing."""


class OnlyRecorded(VrError):
    """Somebody commands what is only a recording."""

    sentence = "this is a recording: nothing in it can be changed, stopped or commanded"


class RecordedTransport:
    """The way to the agents of a recording (`Transport`). Lives on the event loop."""

    def __init__(self, playback: Playback) -> None:
        """Begin at the moment of the playback."""
        self._playback = playback
        self.presence = Presence(held=lambda _: [], unheard=lambda _: [])
        self.identity = Credentials(os.getpid(), os.geteuid())
        self.gate = PolicyGate()
        self._handlers = Handlers[SampleHandler]()
        self._numbers = itertools.count()
        self.presence.count(LOOKUP.key, there=True)

        self._robots = {name: robot.address for name, robot in playback.robots.items()}
        """Those who are there for the listeners, who hear one thing after the other."""
        for address in (*self._robots.values(), *map(view_address, playback.views)):
            self.presence.count(address.key, there=True)
        for robot in playback.robots.values():
            self._see_host(robot)

    def deliver(self, said: Sequence[Content]) -> None:
        """Have those who listen hear what was said."""
        for content in said:
            match content:
                case RobotDescription():
                    self._describe(content)
                case RecordedState(name, state) if name in self._robots:
                    self._tell(f"{self._robots[name].key}/state", state)
                case RecordedLine(name, line) if name in self._robots:
                    self._tell(f"{self._robots[name].key}/log", LogLines(lines=(line,)))
                case RecordedEnd(name):
                    self._leave(name)
                case RecordedPicture(view, _, _) if not self.presence.there(view_address(view).key):
                    self.presence.count(view_address(view).key, there=True)
                    self._list(view_listing(view))
                case _:
                    pass

    def _describe(self, robot: RobotDescription) -> None:
        if self._robots.get(robot.name) != robot.address:
            self._leave(robot.name)  # an earlier life of it
            self._robots[robot.name] = robot.address
            self.presence.count(robot.address.key, there=True)
        self._see_host(robot)
        listing = self._playback.listing(robot)
        if robot.bond is None:
            self._list(listing)
        else:
            self._unlist(robot.address, listing.revision)

    def _see_host(self, robot: RobotDescription) -> None:
        """Have the host of a robot there from now on: a recording has no end of a host."""
        address = Address("host", robot.host, RECORDED)
        if robot.host and not self.presence.there(address.key):
            self.presence.count(address.key, there=True)

    def _leave(self, name: str) -> None:
        if address := self._robots.pop(name, None):
            self.presence.count(address.key, there=False, left=True)
            self._unlist(address, self._playback.revisions.get(name, 0))

    def _list(self, listing: Listing) -> None:
        self._tell(f"{LOOKUP.key}/news", Listed(listing=listing))

    def _unlist(self, address: Address, revision: int) -> None:
        self._tell(f"{LOOKUP.key}/news", Unlisted(address=address, revision=revision))

    def _tell(self, key: str, news: Published) -> None:
        body = encode(news)
        for handler in self._handlers.of(key):
            handler(key, body)

    # -- questions --------------------------------------------------------------------------------

    async def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        """Answer a question at once (`Transport.request`)."""
        del timeout, urgent, void_at
        answer = self._answer(key, body)
        if answer is None:
            raise Unreachable(key=key)
        yield answer

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        """Answer a question at once (`Transport.ask`)."""
        del void_at, urgent
        if (answer := self._answer(key, body)) is not None:
            on_reply(answer)
        on_reply(None)

    def _answer(self, key: str, body: bytes) -> bytes | None:
        """Answer a request; None: nobody serves the key."""
        address = Address.parse(key)
        if address is None or not self.presence.there(key):
            return None
        try:
            return encode(self._reply(address, read_envelope(body).request))
        except VrError as error:
            return encode(Raised.of(error))

    def _reply(self, address: Address, request: AnyRequest) -> Reply:  # noqa: PLR0911 # a table of requests
        playback, name = self._playback, address.name
        match request:
            case Query():
                return Found(listings=tuple((listing, TERM) for listing in playback.listings()))
            case ReadHistory():
                return History()
            case Describe() if (robot := playback.described(name)) is not None:
                return Described(robot=robot)
            case ReadLog():
                return Logged(lines=playback.log(name))
            case DescribeHost():
                return HostDescribed(address=address, robots=playback.robots_of(name))
            case DescribeView():
                return playback.view(name)
            case Look():
                return self._picture(playback.views[name], request)
            case _:
                raise OnlyRecorded

    def _picture(self, pictures: Mapping[str, RecordedPicture], request: Look) -> Picture:
        camera = request.camera or min(pictures)
        if camera not in pictures:
            raise OnlyRecorded
        # its size is that of the recording: who draws it reads it from the picture
        return Picture(jpeg=pictures[camera].jpeg, width=request.width, height=request.height, camera=camera)

    # -- what nobody needs here -------------------------------------------------------------------

    async def subscribe(self, pattern: str, handler: SampleHandler) -> Registration:
        """Take what is published from now on (`Transport.subscribe`)."""
        number = next(self._numbers)
        self._handlers.add(number, pattern, handler)
        return _Undone(partial(self._handlers.remove, number))

    def publish(self, key: str, body: bytes) -> None:
        """Nobody else is there (`Transport.publish`)."""

    def listeners(self, key: str) -> int:
        """Nobody else is there (`Transport.listeners`)."""
        del key
        return 0

    def after_reading(self, job: Callable[[], bool]) -> bool:
        """No thread reads (`Transport.after_reading`)."""
        del job
        return False

    async def serve(self, key: str, take: TakeRequest, *, rank: int = 0) -> Registration:
        """Nobody asks (`Transport.serve`)."""
        del key, take, rank
        return _Undone(lambda: None)

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        """Nobody looks (`Transport.announce`)."""
        del key, unless
        return _Undone(lambda: None)

    async def settle(self, within: float) -> None:
        """All is known (`Transport.settle`)."""

    async def watch_itself(self, handler: CutOffHandler) -> Registration:
        """Nothing can be cut off (`Transport.watch_itself`)."""
        del handler
        return _Undone(lambda: None)

    async def close(self) -> None:
        """End it (`Transport.close`)."""
        self.presence.close()


class _Undone:
    """Something that was declared."""

    def __init__(self, undo: Callable[[], object]) -> None:
        self._undo = undo

    async def close(self) -> None:
        self._undo()
