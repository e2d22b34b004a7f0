"""Orders that nobody may miss: given to one robot or to all at once, and confirmed by each."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from typing import Any

from robotree.vr.address import Address, everyone
from robotree.vr.confirmation import Confirmations, Order
from robotree.vr.errors import Hanging, NotInControl, Unreachable
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.transport import Silent, Transport

CONFIRM = 3.0
"""[s] for all robots to confirm a stop: a round trip over 1 s each way, and some. The stop itself waits for
nothing; this is how long it takes to say that somebody has not confirmed it."""

LOOK = 0.05
"""[s] between two looks at who is there and has not been told."""

Tell = Callable[[RobotClient], Coroutine[Any, Any, None]]
"""Gives one robot the order."""


class Orders:
    """Gives orders to the robots of a realm."""

    def __init__(self, directory: Directory, transport: Transport) -> None:
        """Prepare.

        Args:
            directory: knows the robots by name.
            transport: the way to them.
        """
        self._directory, self._transport = directory, transport

    async def give(self, name: str | None, order: Order, tell: Tell) -> Sequence[str]:
        """Give an order at once to all whom it concerns, also to those who come to sight meanwhile.

        Args:
            name: of the robot; None: all.
            order: in words.
            tell: gives it to one robot.

        Returns:
            The names of those that have confirmed it.

        Raises:
            NoSuchRobot: there is none of this name.
            NotConfirmed: one that lives has not confirmed it, or lives in a process that hangs. All others
                were told before this is raised; it names both.
        """
        asked: dict[Address, asyncio.Future[None]] = {}
        if name is None:
            silent = await self._tell_all(asked, tell)
        else:
            silent = await self._tell_one(name, asked, tell)
        await asyncio.gather(*asked.values(), return_exceptions=True)
        answers = {address: asking.exception() for address, asking in asked.items()}
        silent += await self._fell_silent(name, answers)
        confirmations = Confirmations(order)
        missed = {one.key for one in silent}
        for one in silent:
            address = Address.parse(one.key)
            confirmations.miss(one.key if address is None else address.name, one.where, one.remedy)
        said = {address.name: answer for address, answer in answers.items()}
        for address, answer in answers.items():
            final = _from_above(answer, said)
            # who obeys only its parent has confirmed when that has; when not, the parent's answer names it
            if address.key not in missed and (final is None or final is answer):
                confirmations.take(address.name, final)
        return confirmations.settle()

    # -- inside -----------------------------------------------------------------------------------

    async def _tell_one(
        self, name: str, asked: dict[Address, asyncio.Future[None]], tell: Tell
    ) -> list[Silent]:
        try:
            address = await self._directory.resolve(name)
        except Hanging:
            if silent := await self._transport.silent(everyone("robot", name)):
                return silent
            address = await self._directory.resolve(name)  # it woke up just now
        asked[address] = self._begin(address, tell)
        return []

    async def _tell_all(self, asked: dict[Address, asyncio.Future[None]], tell: Tell) -> list[Silent]:
        """Tell all who are seen at once, then those who come to sight until all have answered."""
        loop = asyncio.get_running_loop()
        latest = loop.time() + CONFIRM
        seen = set(self._directory.present("robot"))
        while True:
            for address in seen - asked.keys():
                asked[address] = self._begin(address, tell)
            silent = await self._transport.silent(everyone("robot"))
            # in this order: who is silent no longer is seen now
            seen = _addresses(await self._transport.present(everyone("robot")))
            waiting = [asking for asking in asked.values() if not asking.done()]
            if loop.time() > latest or not (seen - asked.keys() or silent or waiting):
                return silent
            if waiting:
                await asyncio.wait(waiting, timeout=LOOK)
            elif silent:
                await asyncio.sleep(LOOK)

    async def _fell_silent(
        self, name: str | None, answers: Mapping[Address, BaseException | None]
    ) -> list[Silent]:
        """Return who lives and hangs: of those who gave no answer, somebody else may know more."""
        if not any(answers.values()):
            return []
        lost = [address.key for address, answer in answers.items() if isinstance(answer, Unreachable)]
        found = await asyncio.gather(
            self._transport.silent(everyone("robot", name or "*")), *map(self._directory.hanging, lost)
        )
        return [one for silent in found for one in silent]

    def _begin(self, address: Address, tell: Tell) -> asyncio.Future[None]:
        return asyncio.ensure_future(tell(RobotClient(self._transport, address, patience=CONFIRM)))


def _from_above(
    answer: BaseException | None, said: Mapping[str, BaseException | None]
) -> BaseException | None:
    """Return what the robot said that an enslaved one refers to; its own answer, if nobody asked that."""
    found, passed = answer, set[str]()
    while isinstance(found, NotInControl) and (holder := str(found.data["holder"])) in said.keys() - passed:
        passed.add(holder)
        found = said[holder]
    return found


def _addresses(keys: Iterable[str]) -> set[Address]:
    return {address for address in map(Address.parse, keys) if address is not None}
