"""The operators of a realm: who is here, on which page, and what they say to each other.

Each program says under its own key who sits there, at each change and every `ROUND`; who comes asks all
others to say so at once. Nothing is kept anywhere: who vanishes is gone from all lists when the program is.
What a program says of the person it answers for itself; what counts, who has control of a robot, the robot
knows.

A line is said again until all who are here have confirmed it: a gateway believes a line while the program
that says it is there, so a shell that left right behind its line, and was announced and withdrawn before it,
would not be heard at another site.

What is said crosses to the other sites of the realm by their gateways. A person at another site is named as
robots name them, `anna@hall`; whether a site is heard at all, `silent` says.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import time
from collections.abc import Awaitable, Callable
from typing import Final, NamedTuple

import msgspec

from robotree.vr.base.address import user_of
from robotree.vr.base.envelope import this_terminal
from robotree.vr.base.errors import TransportError, VrError
from robotree.vr.base.foreign import bounded
from robotree.vr.base.places import Places
from robotree.vr.base.principal import user_name
from robotree.vr.base.requests import OperatorHere, OperatorSays, decode_event, encode
from robotree.vr.base.transport import Registration, Transport

ROUND: Final = 2.0
"""[s] after which a program says again who sits there."""
SILENT: Final = 7.0
"""[s] after which one that has said nothing is not shown."""
LONGEST: Final = 200
"""[characters] of a line that operators say."""
ANSWER: Final = 0.4
"""[s] in which all who are awake have answered who asks who is here."""
ANSWER_OF_SITES: Final = 1.5
"""[s] in which those at other sites have: their gateways must hear first that somebody asks."""
CONFIRMING: Final = 5.0
"""[s] that a line waits until all who are here have confirmed it; it is said again meanwhile."""
LINES: Final = 256
"""Lines that are remembered, so that none is shown twice."""
_HERE, _SAYS = "caller/*/here", "caller/*/says"


class LineSaid(NamedTuple):
    """What became of a line."""

    heard: int
    """How many operators have confirmed that they show it."""
    silent: tuple[str, ...]
    """The persons who are here and have not."""


class OperatorSeen(NamedTuple):
    """An operator as others see them."""

    key: str
    """Of the program."""
    person: str
    page: str
    robot: str
    since: float
    """[s] since 1970."""


class Operators:
    """Says who sits here, and hears the others; see the module."""

    def __init__(self, transport: Transport, caller: Callable[[], Awaitable[str]]) -> None:
        """Prepare; `open` begins.

        Args:
            transport: the way to the others.
            caller: returns the key under which this program is present.
        """
        self._transport, self._caller = transport, caller
        self._places = Places(transport.presence)
        self._me = OperatorHere(person=f"{user_name(os.geteuid())}@{this_terminal()}", since=time.time())
        self._heard: dict[str, tuple[OperatorHere, float]] = {}
        self._key = ""
        self._registrations: list[Registration] = []
        self._task: asyncio.Task[None] | None = None
        self._numbers = itertools.count(1)
        self._lines: dict[tuple[str, int], None] = {}
        """The last lines that were heard: key of the program, and number."""
        self._unconfirmed: dict[str, set[str]] = {}
        """The keys that have not confirmed a line of ours, by what they would confirm."""
        self._confirmed = asyncio.Event()
        self.on_said: list[Callable[[str, str], object]] = []
        """Told of each line: who says it, and what."""

    @property
    def person(self) -> str:
        """The person who sits here."""
        return self._me.person

    @property
    def silent(self) -> tuple[str, ...]:
        """The other sites of which nothing is heard: who sits there is not known."""
        return tuple(filter(self._places.silent, self._places.sites()))

    def here(self) -> list[OperatorSeen]:
        """Return who is here, this person included, those who came first in front."""
        now = asyncio.get_running_loop().time()
        present = self._transport.presence.there
        found = [
            OperatorSeen(key, said.person, said.page, said.robot, said.since)
            for key, (said, heard) in self._heard.items()
            if now - heard < SILENT and present(key)
        ]
        if self._task is not None:
            found.append(OperatorSeen(self._key, *msgspec.structs.astuple(self._me)[:4]))
        return sorted(found, key=lambda each: (each.since, each.key))

    async def open(self) -> None:
        """Be here, and hear the others. Twice is once."""
        if self._task is not None:
            return
        await self.listen()
        self._task = asyncio.create_task(self._repeat(), name="who is here")

    async def listen(self) -> None:
        """Hear the others, and ask them who they are; one's own program is no operator's."""
        if not self._registrations:
            self._key = await self._caller()
            for pattern, take in ((_HERE, self._take_here), (_SAYS, self._take_said)):
                self._registrations.append(await self._transport.subscribe(pattern, take))

    async def ask(self) -> list[OperatorSeen]:
        """Ask all who is here, and return who has answered."""
        await self.listen()
        afar = len(self.silent) < len(self._places.sites())
        until = asyncio.get_running_loop().time() + (ANSWER_OF_SITES if afar else ANSWER)
        while (now := asyncio.get_running_loop().time()) < until:
            self._publish("here", msgspec.structs.replace(self._me, asks=True, leaves=self._task is None))
            await asyncio.sleep(min(ANSWER / 4, until - now))
        return self.here()

    async def close(self) -> None:
        """Be gone. Twice is once."""
        task, self._task = self._task, None
        registrations, self._registrations = self._registrations, []
        if task is not None:
            self._publish("here", msgspec.structs.replace(self._me, leaves=True))
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        for registration in registrations:
            await registration.close()

    def show(self, page: str, robot: str) -> None:
        """Say what is in front, if that has changed."""
        if (page, robot) != (self._me.page, self._me.robot):
            self._me = msgspec.structs.replace(self._me, page=page, robot=robot)
            if self._task is not None:
                self._publish("here", self._me)

    async def say(self, text: str) -> LineSaid:
        """Say a line to all other operators, and wait until they have it. Who is not here asks first."""
        here = self.here() if self._task is not None else await self.ask()
        others = {each.key: each.person for each in here if each.key != self._key}
        number, loop = next(self._numbers), asyncio.get_running_loop()
        line = OperatorSays(person=self._me.person, text=bounded(text, LONGEST), number=number)
        named, missing = f"{self._key}/{number}", set(others)
        self._unconfirmed[named] = missing
        self._publish("says", line)
        try:
            until = loop.time() + CONFIRMING
            while missing and (left := until - loop.time()) > 0:
                self._confirmed.clear()
                try:
                    async with asyncio.timeout(min(ANSWER, left)):
                        await self._confirmed.wait()
                except TimeoutError:
                    self._publish("says", line)
        finally:
            del self._unconfirmed[named]
        silent = tuple(sorted(others[key] for key in missing))
        return LineSaid(len(others) - len(missing), silent)

    # -- inside -----------------------------------------------------------------------------------

    async def _repeat(self) -> None:
        asks = True
        while True:
            self._publish("here", msgspec.structs.replace(self._me, asks=asks))
            asks = False
            await asyncio.sleep(ROUND)

    def _publish(self, topic: str, said: OperatorHere | OperatorSays) -> None:
        with contextlib.suppress(TransportError):  # it is closed
            self._transport.publish(f"{self._key}/{topic}", encode(said))

    def _event(self, topic: str, body: bytes) -> tuple[str, object]:
        """Return the key of the program that says something, and what; an empty key: it is not believed."""
        key = topic.rpartition("/")[0]
        try:
            event = decode_event(body, key=key)
        except VrError:  # a program of another version
            return "", None
        if key == self._key or not isinstance(event, OperatorHere | OperatorSays):
            return "", None
        name = event.person.partition("@")[0]
        if site := self._places.site_of(key):  # which answers for its users
            return key, msgspec.structs.replace(event, person=f"{name}@{site}")
        user = user_of(key)
        return ("", None) if user is not None and name != user_name(user) else (key, event)

    def _take_here(self, topic: str, body: bytes) -> None:
        key, event = self._event(topic, body)
        if not key or not isinstance(event, OperatorHere):
            return
        if event.leaves:
            self._heard.pop(key, None)
        else:
            said = msgspec.structs.replace(
                event,
                person=bounded(event.person, 80),
                page=bounded(event.page, 80),
                robot=bounded(event.robot, 80),
            )
            self._heard[key] = said, asyncio.get_running_loop().time()
        if event.heard in self._unconfirmed:
            self._unconfirmed[event.heard].discard(key)
            self._confirmed.set()
        if event.asks and self._task is not None:
            self._publish("here", self._me)

    def _take_said(self, topic: str, body: bytes) -> None:
        key, event = self._event(topic, body)
        if not key or not isinstance(event, OperatorSays):
            return
        if event.number and self._task is not None:
            self._publish("here", msgspec.structs.replace(self._me, heard=f"{key}/{event.number}"))
        if not event.number or (key, event.number) not in self._lines:
            self._lines[key, event.number] = None
            while len(self._lines) > LINES:
                del self._lines[next(iter(self._lines))]
            for listener in self.on_said:
                listener(bounded(event.person, 80), bounded(event.text, LONGEST))
