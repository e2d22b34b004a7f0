"""How a parent asks a robot to become its child, so that both agree on the answer, also when it is lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robotree.vr.address import Address
from robotree.vr.bond import Bond
from robotree.vr.errors import CycleOfBonds, Garbled, TransportError, Unreachable, VrError
from robotree.vr.exchange.client import RobotClient, fresh_key
from robotree.vr.lease import Lessee
from robotree.vr.requests import Granted
from robotree.vr.transport import Transport

RECEIPT = 2.0
"""[s] for a child to confirm that a petition is taken back, before it is told again."""

RETRY = 0.2
"""[s] before a child that cannot be reached is told again that a petition is taken back."""

REUNION = 2.0
"""[s] for the link to a child that lives to come back: it is dialled at least once a second."""


class Petitioner:
    """Asks for leases in the name of one virtual robot."""

    def __init__(
        self, parent: Address, transport: Transport, *, lineage: Callable[[], tuple[str, ...]], term: float
    ) -> None:
        """Prepare.

        Args:
            parent: the virtual robot.
            transport: the way to those it asks.
            lineage: returns the names from the topmost ancestor down to the virtual robot.
            term: [s] asked for.
        """
        self._parent, self._transport, self._lineage, self._term = parent, transport, lineage, term
        self._retracting: set[asyncio.Task[None]] = set()

    async def ask(self, client: RobotClient, slot: str, kind: str) -> Bond:
        """Ask a robot to become the child in a slot.

        Args:
            client: the way to the robot.
            slot: of the parent.
            kind: that the slot takes.

        Returns:
            The bond, under a lease that begins when it was asked for.

        Raises:
            BondError: the robot is of another kind.
            LeaseError: it has another parent, or is an ancestor.
            TransportError: it does not answer; it will be told that nobody heard, should it have agreed.
        """
        key = fresh_key()
        try:
            return await self._ask(client, slot, kind, key)
        except BaseException as error:
            if isinstance(error, TransportError) or not isinstance(error, VrError):
                self._retract(client, key)
            raise

    async def close(self, within: float) -> None:
        """Wait until all whose answers were lost know of it, `within` seconds [s] at most."""
        if self._retracting:
            _, late = await asyncio.wait(self._retracting, timeout=within)
            for task in late:
                task.cancel()

    # -- inside -----------------------------------------------------------------------------------

    async def _ask(self, client: RobotClient, slot: str, kind: str, key: str) -> Bond:
        lineage, child = self._lineage(), client.address
        if child.name in lineage:
            raise CycleOfBonds(parent=self._parent.name, child=child.name, lineage=" > ".join(lineage))

        async def petition() -> tuple[float, Granted]:
            return _now(), await client.petition(
                self._parent, slot, kind=kind, lineage=lineage, term=self._term, key=key
            )

        try:
            sent, granted = await petition()
        except Unreachable:
            if not await self._lives(child.key):
                raise
            await self._reunion(child.key)
            sent, granted = await petition()  # the same one: whoever has granted it grants it again
        if granted.robot is None:
            raise Garbled(key=child.key, detail="it grants a lease but does not say who it is")
        lease = Lessee(epoch=granted.epoch, term=granted.term, sent=sent, now=_now())
        return Bond(
            child=child, lease=lease, description=granted.robot, depth=granted.depth, ways=granted.ways
        )

    async def _lives(self, key: str) -> bool:
        """Whether somebody lives under a key, heard or not: after one of two hung, their link is gone."""
        return bool(await self._transport.silent(key) or await self._transport.present(key))

    async def _reunion(self, key: str) -> None:
        """Wait until who lives under a key can be heard, or for long enough."""
        heard = asyncio.Event()
        watching = await self._transport.watch(key, lambda _, there: heard.set() if there else None)
        try:
            async with asyncio.timeout(REUNION):
                await heard.wait()
        except TimeoutError:
            return
        finally:
            await watching.close()

    def _retract(self, client: RobotClient, key: str) -> None:
        async def tell() -> None:
            latest = _now() + self._term  # then the lease is over, if there is one
            while _now() < latest:
                try:
                    await client.retract(self._parent, key, timeout=RECEIPT)
                except TransportError:
                    await asyncio.sleep(RETRY)
                else:
                    return

        task = asyncio.ensure_future(tell())
        self._retracting.add(task)
        task.add_done_callback(self._retracting.discard)


def _now() -> float:
    return asyncio.get_running_loop().time()
