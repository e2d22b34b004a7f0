"""A protective stop and its release, for one robot or all: an error names each that was missed.

No robot delays the others. The robots are read from the presence record of this machine, so no search comes
first. A robot that has not acknowledged the stop is named soon, with its process; one that has acknowledged
it may take as long as its hardware needs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import msgspec

from robotree.vr.base.address import Address, everyone, parted
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.envelope import this_clock
from robotree.vr.base.errors import (
    NoAnswer,
    NoSuchRobot,
    NoSuchSite,
    NotConfirmed,
    NotInControl,
    Unreachable,
    VrError,
)
from robotree.vr.base.presence import Held
from robotree.vr.base.requests import SafeStop
from robotree.vr.base.transport import Transport
from robotree.vr.core.confirmation import HOPELESS, LEAST, Confirmations, unmeasured
from robotree.vr.exchange.asking import fresh_key, send_request
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.directory import Directory

CONFIRM = 3.0
"""[s] for a robot to confirm a stop: a round trip of 1 s each way, and a reserve. The stop itself does not
wait; after this time the robots that have not confirmed it are reported."""

LOOK = 0.05
"""[s] between two searches for robots that have not received the stop."""

LATE = 0.5
"""[s] without an answer from a robot, after which it is named."""

ASLEEP = 0.2
"""[s] without an answer from a robot whose process is stopped, after which it is named."""

UNLISTED = 0.8
"""[s] for a process without an entry to write one: each checks twice a second that its entry exists."""

OnLate = Callable[[str], None]
"""Takes a sentence that names the robots that have not answered yet."""

Counted = Callable[[str, int], None]
"""Takes the key of a robot and how many stops it has counted."""


class StopScope(NamedTuple):
    """Which sites a stop concerns."""

    sites: Sequence[str] = ()
    """The sites of the realm besides this machine; each is named if no gateway reaches it."""
    local: Callable[[str], bool] | None = None
    """Whether the robot of a key is on this machine: then only those are stopped. None: the gateway of this
    machine is asked to stop the robots of all other sites."""


EVERYWHERE = StopScope()


class _StopRequest:
    """One robot that was asked to stop."""

    def __init__(self, address: Address, now: float) -> None:
        self.address, self.since = address, now
        self.acknowledged = False
        """Whether the robot has acknowledged the stop."""
        self.answer: Sequence[str] | VrError | None = None
        self.task: asyncio.Task[None] | None = None

    def acknowledge(self) -> None:
        self.acknowledged = True

    @property
    def waiting(self) -> bool:
        """Whether an answer may still come."""
        return self.task is not None and not self.task.done()


class StopOrder:
    """One order to stop, from giving it to what came of it. Used once, on the event loop."""

    def __init__(
        self,
        directory: Directory,
        transport: Transport,
        name: str | None,
        *,
        reason: str,
        on_late: OnLate,
        counted: Counted,
        order: str = "",
        scope: StopScope = EVERYWHERE,
    ) -> None:
        """Prepare.

        Args:
            directory: knows the robots that are seen.
            transport: the way to them.
            name: of the robot, or `SITE:NAME`; None: all. Without a site the one of this machine is meant,
                and where there is none, all of this name are: a stop asks nobody back.
            reason: for those whose commands it ends.
            on_late: called with the robots that have not answered for a while, each of them once.
            counted: called with how many stops each robot that confirms it has counted.
            order: its id, if it has been sent already (`lean_stop.py`); empty: it is new.
            scope: which sites it concerns.

        Raises:
            BadName: no robot can have this name.
        """
        self._site, self._plain = ("", "*") if name is None else parted(name)
        self._pattern = everyone("robot", self._plain)
        self._directory, self._transport, self._name = directory, transport, name
        self._reason, self._on_late, self._counted = reason, on_late, counted
        self._order = order or fresh_key()
        self._sites, self._local = scope
        self._requests: dict[Address, _StopRequest] = {}
        self._held: dict[Address, Held] = {}
        self._unlisted: dict[str, tuple[Held, float]] = {}
        """Processes whose robots are not known, by name, and since when [s]."""
        self._remote: set[str] = set()
        """Keys of robots of other sites, which are stopped there."""
        self._named: set[str] = set()
        """Keys of the robots and processes that `on_late` has named."""

    async def carry_out(self) -> Sequence[str]:
        """Send the stop to all robots that it concerns, also to new ones, and wait for their answers.

        Returns:
            The names of those that have confirmed it.

        Raises:
            NoSuchRobot: there is none of this name.
            NotConfirmed: a robot has not confirmed it, or may not have been reached; names both groups.
        """
        try:
            while True:
                self._look()
                now = _now()
                if self._settled(now):
                    return self._verdict()
                self._name_the_late(now)
                await self._news()
        finally:
            await self._end()

    # -- requests --------------------------------------------------------------------------------

    def _look(self) -> None:
        """Find the robots that are there, and send the stop to those that have not received it."""
        held = self._meant()
        lost, was = {one.where: one for one in held if not one.key}, self._held
        addresses = ((Address.parse(one.key), one) for one in held)
        self._held = {  # also of processes that have lost their files since the last look
            address: msgspec.structs.replace(old, asleep=lost[old.where].asleep)
            for address, old in was.items()
            if old.where in lost
        } | {address: one for address, one in addresses if address is not None}
        new, before = (None, _now()), self._unlisted
        self._unlisted = {one.where: (one, before.get(one.where, new)[1]) for one in held if not one.key}
        if self._unlisted.keys() - before.keys():
            self._leave_for_unlisted()
        seen = {one for one in self._directory.present("robot", self._plain) if one.key not in self._remote}
        for address in sorted(self._chosen(seen | self._held.keys())):
            if address not in self._requests:
                request = self._requests[address] = _StopRequest(address, _now())
                request.task = asyncio.ensure_future(self._send(request))
        if self._name is not None and self._requests:
            self._unlisted.clear()  # the robot that is meant is found

    def _chosen(self, found: set[Address]) -> set[Address]:
        """Return of those of a name the one of the site that is meant; see `name` above."""
        places = self._directory.places
        if self._name is None or not (places.own or self._site):
            return found
        sites = {address: places.site_of(address.key) or places.own for address in found}
        here = {address for address in found if sites[address] == (self._site or places.own)}
        return here or (set() if self._site else found)

    def _meant(self) -> list[Held]:
        """Return who is to be asked: the robots of this machine, and for the others its gateway, once.

        A robot that is named is asked itself, wherever it is.
        """
        presence = self._transport.presence
        if self._local is not None:
            held = presence.held(self._pattern)
            self._remote = {one.key for one in held if one.key and not self._local(one.key)}
            return [one for one in held if one.key not in self._remote]
        gateways = [one for one in presence.held(everyone("gateway")) if one.key]
        places = {gateway.where for gateway in gateways}
        held = presence.held(self._pattern)
        here = [one for one in held if one.where not in places]
        if self._name is not None:  # nobody shall end the gateway because a robot elsewhere does not answer
            return here
        self._remote = {one.key for one in held if one.key and one.where in places}
        return [*gateways, *here]

    async def _send(self, request: _StopRequest) -> None:
        """Ask one robot to stop, until it has answered or its time is over."""
        client, until = RobotClient(self._transport, request.address), request.since + CONFIRM
        while (left := until - _now()) > LEAST:
            try:
                request.answer = await client.safe_stop(
                    self._reason,
                    order=self._order,
                    timeout=left,
                    accepted=request.acknowledge,
                    counted=partial(self._counted, request.address.key),
                )
            except Unreachable as error:  # its process has ended, or is on its way
                if request.address in self._held or self._unlisted:
                    await asyncio.sleep(LOOK)
                    continue
                request.answer = error
            except NoAnswer:
                pass
            except VrError as error:
                request.answer = error
            return

    def _leave_for_unlisted(self) -> None:
        """Leave the stop with processes whose robots nobody knows: who is frozen reads it when it wakes."""
        stop = SafeStop(reason=self._reason, order=self._order, within=unmeasured(CONFIRM))
        send_request(
            self._transport,
            self._pattern,
            stop,
            lambda _: None,
            now=_now(),
            within=CONFIRM,
            urgent=True,
        )

    # -- judging ----------------------------------------------------------------------------------

    def _settled(self, now: float) -> bool:
        """Whether nothing more can come of it, or all time is over."""
        fresh = any(now < since + UNLISTED for _, since in self._unlisted.values())
        return not fresh and not any(self._awaited(request, now) for request in self._requests.values())

    def _awaited(self, request: _StopRequest, now: float) -> bool:
        held = self._held.get(request.address)
        hopeless = (
            not request.acknowledged and held is not None and held.asleep and now > request.since + HOPELESS
        )
        return request.waiting and not hopeless

    def _name_the_late(self, now: float) -> None:
        late: dict[str, str] = {}
        for address, request in self._requests.items():
            held = self._held.get(address)
            if (
                not request.acknowledged
                and request.waiting
                and now > request.since + (ASLEEP if held and held.asleep else LATE)
            ):
                name = self._directory.places.shown(address).name
                late[address.key] = name if held is None else f"{name} (in {held.in_words})"
        late |= {where: where for where, (_, since) in self._unlisted.items() if now > since + LATE}
        if names := [words for key, words in late.items() if key not in self._named]:
            self._named.update(late)
            self._on_late(f"the protective stop goes on, without an answer yet from {', '.join(names)}")

    def _verdict(self) -> Sequence[str]:
        confirmations = Confirmations("the protective stop")
        if self._name is not None and not self._requests and not self._unlisted:
            self._miss_named(confirmations, self._name)
        for address, request in self._requests.items():
            if address.role == "gateway":
                self._judge_gateway(confirmations, address, self._held.get(address), request.answer)
            else:
                self._judge(confirmations, request)
        for one, _ in self._unlisted.values():
            confirmations.miss(one.where, one.how, one.remedy)
        if self._name is None and not any(address.role == "gateway" for address in self._requests):
            for site in self._sites:
                self._miss_site(confirmations, site, "no gateway runs on this machine")
        return confirmations.settle()

    def _judge(self, confirmations: Confirmations, request: _StopRequest) -> None:
        """Take what a robot has answered. Of two sites' robots of one name neither hides the other."""
        address, answer = request.address, request.answer
        held, name = self._held.get(address), self._directory.places.shown(address).name
        if answer is not None and not (held and isinstance(answer, Unreachable)):
            confirmations.take(name, answer)
        elif request.acknowledged:
            confirmations.deny(name, "it has received the stop and has not confirmed it")
        elif held is not None:
            confirmations.miss(name, f"in {held.in_words}", held.remedy)
        elif site := self._directory.places.site_of(address.key):
            confirmations.miss(
                name, f"no answer from site {site}", f"`robotree doctor`, or stop it at {site}"
            )
        else:
            confirmations.take(name, NoAnswer(key=address.key, seconds=CONFIRM))

    def _miss_named(self, confirmations: Confirmations, name: str) -> None:
        """Nobody has the name here: at sites that are not heard somebody may.

        Raises:
            NoSuchRobot: all sites are heard, and there is none.
            NoSuchSite: nor is there the site.
        """
        places, sites = self._directory.places, self._directory.places.sites()
        if self._site and self._site != places.own and self._site not in sites:
            raise NoSuchSite.among(self._site, sites)
        away = [site for site in sites if places.silent(site) and self._site in {"", site}]
        if not away:
            raise NoSuchRobot(name=name)
        for site in away:
            confirmations.miss(
                f"{site}:{self._plain}",
                f"site {site} is not heard, and it may be there",
                f"`robotree doctor` says why, or stop it at {site}",
            )

    def _judge_gateway(
        self,
        confirmations: Confirmations,
        address: Address,
        held: Held | None,
        answer: Sequence[str] | VrError | None,
    ) -> None:
        """Take what a gateway says of all other sites; one that says nothing has reached none of them."""
        if isinstance(answer, NotConfirmed):
            confirmations.report(answer)
        elif answer is not None and not isinstance(answer, VrError):
            for name in answer:
                confirmations.confirm(name)
        else:
            reason = "the gateway of this machine did not answer"
            for site in self._sites:
                self._miss_site(confirmations, site, reason)
            where = "" if held is None else f", in {held.in_words}"
            confirmations.miss(f"gateway {address.name}", f"it did not answer{where}", "start it again")

    def _miss_site(self, confirmations: Confirmations, site: str, why: str) -> None:
        remedy = "start `robotree gateway` here, then stop again; or stop the robots of the other sites there"
        confirmations.miss(f"site {site}", f"not reached: {why}", remedy)

    # -- inside -----------------------------------------------------------------------------------

    async def _news(self) -> None:
        """Wait until a robot has answered, or for a moment."""
        if tasks := [request.task for request in self._requests.values() if request.task and request.waiting]:
            await asyncio.wait(tasks, timeout=LOOK, return_when=asyncio.FIRST_COMPLETED)
        else:
            await asyncio.sleep(LOOK)

    async def _end(self) -> None:
        tasks = [request.task for request in self._requests.values() if request.task]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _now() -> float:
    return asyncio.get_running_loop().time()


# -- the release of stops, for one robot or all, confirmed by each ---------------------------------


MOST_COUNTS = 4096
"""Robots whose count is remembered."""
UNSEEN = "it came to sight only after that had been asked for"

Asked = dict[Address, asyncio.Future[Sequence[str]]]
"""The answer of each robot: the names of those that have confirmed, or an error."""
Looks = Mapping[Address, asyncio.Future[RobotDescription]]
"""How each robot in sight describes itself, as soon as it has answered."""


class Releases:
    """Releases stops of the robots of a realm, and keeps the counts of stops that this needs.

    A stop is also for robots that appear while it is given. A release is only for those that are there when
    it is asked for, and ends no stop that the person could not know of: the robots count their stops, and the
    release names the counts that were known here when the key was pressed. Robots say their count in each
    state that they publish, in their description, and when they confirm a stop. A program that does not watch
    the states, such as a command line that has just started, asks for the counts first. The release also says
    when it was given, so that a stop that came while the counts were asked for stays in force.
    """

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
