"""One bond in force, kept so from the parent's side: its lease renewed, its end noticed.

Renewals are tasks of their own, ahead of everything on the wire, and may overlap: a slow way or a busy robot
never makes them queue behind one another or behind commands.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable

from robotree.vr.address import Address
from robotree.vr.bond import Bond
from robotree.vr.errors import LeaseError, TransportError, Unreachable, VrError
from robotree.vr.exchange.client import RobotClient
from robotree.vr.transport import Registration, Transport

TICK = 0.001
"""[s] Shorter waits are none."""

_log = logging.getLogger(__name__)


class Link:
    """One bond in force, with what keeps it so. Lives on the event loop."""

    def __init__(
        self,
        slot: str,
        bond: Bond,
        client: RobotClient,
        *,
        parent: Address,
        transport: Transport,
        lineage: Callable[[], tuple[str, ...]],
        on_change: Callable[[], None],
        on_loss: Callable[[Link, str], None],
    ) -> None:
        """Take a bond that was just granted; `start` begins to keep it.

        Args:
            slot: of the parent.
            bond: the child, its lease and its description.
            client: the way to the child.
            parent: the virtual robot.
            transport: where the child's presence is seen.
            lineage: returns the names from the topmost ancestor down to the parent.
            on_change: told when more is known of the child.
            on_loss: told that the bond is over, and why; more than once perhaps.
        """
        self.slot, self.bond, self.client = slot, bond, client
        self.over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the bond has ended, however."""
        self.hurry = asyncio.Event()
        """Set to renew now."""
        self._parent, self._transport, self._lineage = parent, transport, lineage
        self._on_change, self._on_loss = on_change, on_loss
        self._tasks: set[asyncio.Task[None]] = set()
        self._watching: Registration | None = None

    def start(self) -> None:
        """Renew the lease and watch the child from now on."""
        self._spawn(self._keep())
        self._spawn(self._watch())

    def end(self) -> asyncio.Task[None] | None:
        """Keep it no more; returns what is left to be waited for."""
        self.over.set_result(None)
        for task in self._tasks - {asyncio.current_task()}:
            task.cancel()
        return None if self._watching is None else asyncio.ensure_future(self._watching.close())

    # -- inside -----------------------------------------------------------------------------------

    def _spawn(self, work: Awaitable[None]) -> None:
        """Run something until it is done or the bond is over."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _keep(self) -> None:
        lease = self.bond.lease
        while (left := lease.expires - _now()) > TICK:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(min(max(lease.due - _now(), TICK), left)):
                    await self.hurry.wait()
            if self.hurry.is_set() or lease.due - _now() < TICK:
                self.hurry.clear()
                lease.asked(_now())
                self._spawn(self._renew())
        self._on_loss(self, f"{self.bond.child.name} did not answer for {lease.term:.3g} s")

    async def _renew(self) -> None:
        lease, child = self.bond.lease, self.bond.child
        sent = _now()
        try:
            granted = await self.client.renew(
                self._parent, lease.epoch, lineage=self._lineage(), timeout=lease.term
            )
        except LeaseError as error:
            self._on_loss(self, str(error))
        except Unreachable:
            with contextlib.suppress(VrError):
                if not await self._transport.present(child.key):
                    self._on_loss(self, f"{child.name} has ended")
        except TransportError:
            pass  # the next one may get through
        except VrError as error:
            _log.warning("%s: renewal for %s: %s", self._parent.name, self.slot, error)
        else:
            lease.granted(sent=sent, now=_now(), term=granted.term)
            self.bond.depth, self.bond.ways = granted.depth, granted.ways
            if granted.robot is not None:
                self.bond.description = granted.robot
                self._on_change()

    async def _watch(self) -> None:
        child = self.bond.child

        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a presence handler
            if not there:
                self._on_loss(self, f"{child.name} has ended or cannot be reached")

        with contextlib.suppress(VrError):
            self._watching = await self._transport.watch(child.key, look)


def _now() -> float:
    return asyncio.get_running_loop().time()
