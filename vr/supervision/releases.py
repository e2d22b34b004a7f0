"""The release of stops, for one robot or all, confirmed by each.

A stop (`stop.py`) is also for robots that appear while it is given. A release is only for those that are
there when it is asked for, and ends no stop that the person could not know of: the robots count their stops,
and the release names the counts that were known here when the key was pressed. Robots say their count in each
state that they publish, in their description, and when they confirm a stop. A program that does not watch the
states, such as a command line that has just started, asks for the counts first. The release also says when it
was given, so that a stop that came while the counts were asked for stays in force.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence

from robotree.vr.base.address import Address, everyone, parted
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.envelope import this_clock
from robotree.vr.base.errors import NoSuchRobot, NotInControl, VrError
from robotree.vr.base.presence import Held
from robotree.vr.base.transport import Transport
from robotree.vr.core.confirmation import Confirmations
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.supervision.stop import CONFIRM

MOST_COUNTS = 4096
"""Robots whose count is remembered."""
UNSEEN = "it came to sight only after that had been asked for"

Asked = dict[Address, asyncio.Future[Sequence[str]]]
"""The answer of each robot: the names of those that have confirmed, or an error."""
Looks = Mapping[Address, asyncio.Future[RobotDescription]]
"""How each robot in sight describes itself, as soon as it has answered."""


class Releases:
    """Releases stops of the robots of a realm, and keeps the counts of stops that this needs."""

    def __init__(self, directory: Directory, transport: Transport) -> None:
        """Prepare.

        Args:
            directory: knows the robots by name.
            transport: the way to them.
        """
        self._directory, self._transport = directory, transport
        self._counts: dict[str, int] = {}
        """How many stops each robot has counted, as far as it is known here, by key."""
        self.watches = 0
        """How many watches of all states are open; without any, the counts are asked for."""

    def count(self, key: str, stops: int) -> None:
        """Note how many stops a robot has counted; -1: it does not report a number."""
        most = max(self._counts.pop(key, -1), stops)
        if most >= 0:
            self._counts[key] = most  # at the end
        while len(self._counts) > MOST_COUNTS:
            del self._counts[next(iter(self._counts))]

    async def resume(self, name: str | None, given: float | None = None) -> Sequence[str]:
        """End the stops that are in force and known here now; see `RealmClient.resume`.

        Args:
            name: of the robot; None: all.
            given: [s] on the event loop's clock, when a person gave it; None: now.

        Returns:
            The names of those that have confirmed it, without those that were in no stop.

        Raises:
            NoSuchRobot: there is none of this name.
            NotConfirmed: one has not confirmed it, or has been stopped again; it names both sides.
        """
        pattern = everyone("robot", "*" if name is None else parted(name)[1])
        meant = self._meant(name)
        given = asyncio.get_running_loop().time() if given is None else given
        known = dict(self._counts) if self.watches else {}
        # of all, whichever is meant: what is below one is known only when it has answered
        looks = {address: self._look(address) for address in self._directory.present("robot")}
        asked = {
            address: self._begin_to_resume(address, looks, known, given)
            for address in looks
            if meant is None or address in meant
        }
        confirmations = Confirmations("the resume")
        try:
            silent = await self._transport.presence.hanging(pattern)
            late = set(self._directory.present("robot", name or "*")) - looks.keys()
            for address in late:
                confirmations.deny(self._shown(address), UNSEEN)
            if name is not None and not (asked or late or silent):
                await self._directory.resolve(name)  # it says why not
                raise NoSuchRobot(name=name)
            confirmed = await self._judge(pattern, confirmations, asked, silent)
            free = {self._shown(address) for address, look in looks.items() if _is_free(look)}
            return [each for each in confirmed if each not in free]
        finally:
            for look in looks.values():
                look.cancel()
            await asyncio.gather(*looks.values(), return_exceptions=True)

    # -- inside -----------------------------------------------------------------------------------

    def _meant(self, name: str | None) -> set[Address] | None:
        """Return the robots of a name: those of this machine, or of the site in it; None: all are meant.

        Raises:
            SeveralSites: there is none here, and several elsewhere.
        """
        if name is None:
            return None
        found = self._directory.present("robot", name)
        return set(found if len(found) < 2 else self._directory.nearest(found, "robot", parted(name)[1]))

    def _shown(self, address: Address) -> str:
        return self._directory.places.shown(address).name

    def _client(self, address: Address) -> RobotClient:
        return RobotClient(self._transport, address, patience=CONFIRM)

    def _look(self, address: Address) -> asyncio.Future[RobotDescription]:
        return asyncio.ensure_future(self._client(address).describe(urgent=True))

    def _begin_to_resume(
        self, address: Address, looks: Looks, known: Mapping[str, int], given: float
    ) -> asyncio.Future[Sequence[str]]:
        async def resume() -> Sequence[str]:
            seen = await _seen(address, looks)
            for key, stops in seen.items():
                self.count(key, stops)
            seen |= {key: stops for key, stops in known.items() if key in seen}
            return await self._client(address).resume(seen=seen, given=given, clock=this_clock())

        return asyncio.ensure_future(resume())

    async def _judge(
        self, pattern: str, confirmations: Confirmations, asked: Asked, silent: list[Held]
    ) -> Sequence[str]:
        """Wait for all answers and return which robots have confirmed."""
        results = await asyncio.gather(*asked.values(), return_exceptions=True)
        answers = dict(zip(asked, results, strict=True))
        failed = {address.key for address, answer in answers.items() if isinstance(answer, BaseException)}
        if failed:  # of those who gave no answer, somebody else may know more
            silent = silent + await self._transport.presence.hanging(pattern)
        missed = {one.key: one for one in silent if one.key in failed or Address.parse(one.key) not in asked}
        for key, one in missed.items():
            address = Address.parse(key)
            confirmations.miss(
                key if address is None else self._shown(address), f"in {one.in_words}", one.remedy
            )
        # those last who obey only their parent: it may have told them, and then it names them
        for address, answer in sorted(answers.items(), key=lambda each: isinstance(each[1], NotInControl)):
            name = self._shown(address)
            above = isinstance(answer, NotInControl) and confirmations.names(name)
            if address.key not in missed and not above:
                confirmations.take(name, answer)
        return confirmations.settle()


def _is_free(look: asyncio.Future[RobotDescription]) -> bool:
    """Whether a robot has said that it was in no stop."""
    said = look.done() and not look.cancelled() and look.exception() is None
    return said and not look.result().stopped


async def _seen(address: Address, looks: Looks) -> dict[str, int]:
    """Return how often a robot and those below it have been stopped, of all that have reported it, by key.

    Raises:
        VrError: the robot has not.
    """
    seen: dict[str, int] = {}
    ahead = [address]
    for each in ahead:  # it grows while it is walked through
        if each.key in seen or each not in looks:
            continue
        try:
            description = await looks[each]
        except VrError:
            if each == address:
                raise
        else:
            seen[each.key] = description.stops
            ahead += [slot.child for slot in description.slots if slot.child is not None]
    return seen
