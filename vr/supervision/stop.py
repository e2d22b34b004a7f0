"""One protective stop, for one robot or all: no robot delays the others, and what was missed is named.

The robots are read from the record that the machine keeps of what lives, so no search comes first. A robot
that has not even said that it has the stop is named soon, with its process; one that has it may take as long
as its hardware needs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

import msgspec

from robotree.vr.base.address import Address, check_name, everyone
from robotree.vr.base.errors import NoAnswer, NoSuchRobot, Unreachable, VrError
from robotree.vr.base.presence import Held
from robotree.vr.base.transport import Transport
from robotree.vr.core.confirmation import LEAST, Confirmations
from robotree.vr.exchange.client import RobotClient, fresh_key
from robotree.vr.lookup.directory import Directory

CONFIRM = 3.0
"""[s] for a robot to confirm a stop: a round trip over 1 s each way, and some. The stop itself waits for
nothing; this is how long it takes to say that somebody has not confirmed it."""

LOOK = 0.05
"""[s] between two looks at who is there and has not been told."""

LATE = 0.5
"""[s] without a word from a robot, after which it is named."""

ASLEEP = 0.2
"""[s] without a word from a robot whose process is stopped, after which it is named."""

HOPELESS = 0.6
"""[s] after which nobody waits any more for a robot whose process is stopped: somebody may wake it."""

UNLISTED = 0.8
"""[s] for a process without a name to take one: each looks twice a second whether its own is there."""

OnLate = Callable[[str], None]
"""Takes a sentence that names the robots that have not answered yet."""

Counted = Callable[[str, int], None]
"""Takes the key of a robot and how many stops it has counted."""


class _Told:
    """One robot that was asked to stop."""

    def __init__(self, address: Address, now: float) -> None:
        self.address, self.since = address, now
        self.heard = False
        """Whether it has said that it has the stop."""
        self.answer: Sequence[str] | VrError | None = None
        self.telling: asyncio.Task[None] | None = None

    def hear(self) -> None:
        self.heard = True

    @property
    def waiting(self) -> bool:
        """Whether an answer may still come."""
        return self.telling is not None and not self.telling.done()


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
    ) -> None:
        """Prepare.

        Args:
            directory: knows the robots that are seen.
            transport: the way to them.
            name: of the robot; None: all.
            reason: for those whose commands it ends.
            on_late: called with the robots that have not answered for a while, each of them once.
            counted: called with how many stops each robot that confirms it has counted.

        Raises:
            BadName: no robot can have this name.
        """
        self._pattern = everyone("robot", "*" if name is None else check_name(name))
        self._directory, self._transport, self._name = directory, transport, name
        self._reason, self._on_late, self._counted = reason, on_late, counted
        self._order = fresh_key()
        self._told: dict[Address, _Told] = {}
        self._held: dict[Address, Held] = {}
        self._unlisted: dict[str, tuple[Held, float]] = {}
        """Processes of which nobody knows what they hold, by name, and since when [s]."""
        self._named: set[str] = set()
        """Keys of the robots and processes that `on_late` has named."""

    async def give(self) -> Sequence[str]:
        """Tell all robots that it concerns, also those that appear meanwhile, and wait for what they say.

        Returns:
            The names of those that have confirmed it.

        Raises:
            NoSuchRobot: there is none of this name.
            NotConfirmed: one has not confirmed it, or may have been missed; it names both sides.
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

    # -- telling ----------------------------------------------------------------------------------

    def _look(self) -> None:
        """Look which robots are there, and ask those that were not asked before."""
        held = self._transport.presence.held(self._pattern)
        lost, was = {one.where: one for one in held if not one.key}, self._held
        addresses = ((Address.parse(one.key), one) for one in held)
        self._held = {  # also of processes that have lost their files since the last look
            address: msgspec.structs.replace(old, asleep=lost[old.where].asleep)
            for address, old in was.items()
            if old.where in lost
        } | {address: one for address, one in addresses if address is not None}
        new, before = (None, _now()), self._unlisted
        self._unlisted = {one.where: (one, before.get(one.where, new)[1]) for one in held if not one.key}
        seen = set(self._directory.present("robot", self._name or "*"))
        for address in sorted(seen | self._held.keys()):
            if address not in self._told:
                told = self._told[address] = _Told(address, _now())
                told.telling = asyncio.ensure_future(self._tell(told))
        if self._name is not None and self._told:
            self._unlisted.clear()  # the robot that is meant is found

    async def _tell(self, told: _Told) -> None:
        """Ask one robot to stop, until it has answered or its time is over."""
        client, until = RobotClient(self._transport, told.address), told.since + CONFIRM
        while (left := until - _now()) > LEAST:
            try:
                told.answer = await client.safe_stop(
                    self._reason,
                    order=self._order,
                    timeout=left,
                    accepted=told.hear,
                    counted=partial(self._counted, told.address.key),
                )
            except Unreachable as error:  # its process has ended, or is on its way
                if told.address in self._held or self._unlisted:
                    await asyncio.sleep(LOOK)
                    continue
                told.answer = error
            except NoAnswer:
                pass
            except VrError as error:
                told.answer = error
            return

    # -- judging ----------------------------------------------------------------------------------

    def _settled(self, now: float) -> bool:
        """Whether nothing more can come of it, or all time is over."""
        fresh = any(now < since + UNLISTED for _, since in self._unlisted.values())
        return not fresh and not any(self._awaited(told, now) for told in self._told.values())

    def _awaited(self, told: _Told, now: float) -> bool:
        held = self._held.get(told.address)
        hopeless = not told.heard and held is not None and held.asleep and now > told.since + HOPELESS
        return told.waiting and not hopeless

    def _name_the_late(self, now: float) -> None:
        late: dict[str, str] = {}
        for address, told in self._told.items():
            held = self._held.get(address)
            if (
                not told.heard
                and told.waiting
                and now > told.since + (ASLEEP if held and held.asleep else LATE)
            ):
                late[address.key] = address.name if held is None else f"{address.name} (in {held.in_words})"
        late |= {where: where for where, (_, since) in self._unlisted.items() if now > since + LATE}
        if names := [words for key, words in late.items() if key not in self._named]:
            self._named.update(late)
            self._on_late(f"the protective stop goes on, with no word yet from {', '.join(names)}")

    def _verdict(self) -> Sequence[str]:
        if self._name is not None and not self._told and not self._unlisted:
            raise NoSuchRobot(name=self._name)
        confirmations = Confirmations("the protective stop")
        for address, told in self._told.items():
            held, answer = self._held.get(address), told.answer
            if answer is not None and not (held and isinstance(answer, Unreachable)):
                confirmations.take(address.name, answer)
            elif told.heard:
                confirmations.deny(address.name, "it has the stop and has not confirmed it")
            elif held is not None:
                confirmations.miss(address.name, f"in {held.in_words}", held.remedy)
            else:
                confirmations.take(address.name, NoAnswer(key=address.key, seconds=CONFIRM))
        for one, _ in self._unlisted.values():
            confirmations.miss(one.where, one.how, one.remedy)
        return confirmations.settle()

    # -- inside -----------------------------------------------------------------------------------

    async def _news(self) -> None:
        """Wait until a robot has answered, or for a moment."""
        if tellings := [told.telling for told in self._told.values() if told.telling and told.waiting]:
            await asyncio.wait(tellings, timeout=LOOK, return_when=asyncio.FIRST_COMPLETED)
        else:
            await asyncio.sleep(LOOK)

    async def _end(self) -> None:
        tellings = [told.telling for told in self._told.values() if told.telling]
        for telling in tellings:
            telling.cancel()
        await asyncio.gather(*tellings, return_exceptions=True)


def _now() -> float:
    return asyncio.get_running_loop().time()
