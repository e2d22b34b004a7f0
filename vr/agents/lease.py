"""The child's side of a bond, at work: it ends when its time or its parent does."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robotree.vr.address import Address
from robotree.vr.errors import CycleOfBonds, VrError
from robotree.vr.lease import Lessor, Tenure
from robotree.vr.requests import Petition, Renew
from robotree.vr.transport import Transport

OnEnd = Callable[[Tenure, str], None]
"""Told of a lease that is over, and why."""


class LeaseKeeper:
    """Keeps one robot's lessor to the clock and to its parent's presence."""

    def __init__(
        self,
        lessor: Lessor,
        transport: Transport,
        *,
        unix: Callable[[], float],
        obeyed: Callable[[], int | None],
        on_end: OnEnd,
    ) -> None:
        """Begin free.

        Args:
            lessor: the rules.
            transport: where the parent's presence is seen.
            unix: returns seconds since 1970.
            obeyed: returns the epoch that what stands behind the robot obeys, None before it was heard; see
                `Lessor.hear`.
            on_end: told on the event loop when a lease is over.
        """
        self.lessor = lessor
        self._transport, self._unix, self._obeyed, self._on_end = transport, unix, obeyed, on_end
        self._timer: asyncio.TimerHandle | None = None
        self._watching: asyncio.Task[None] | None = None

    @property
    def tenure(self) -> Tenure | None:
        """The lease in force."""
        self._tick()
        return self.lessor.tenure

    @property
    def remaining(self) -> float:
        """[s] left of the lease in force; 0 without one."""
        tenure = self.tenure
        return 0.0 if tenure is None else tenure.expires - _now()

    def check(self, epoch: int | None) -> None:
        """Refuse a caller who may not command the robot: see `Lessor.check`."""
        self._tick()
        self.lessor.check(epoch)

    @property
    def outranked(self) -> bool:
        """Whether the robot is free here, and somebody else commands it nevertheless: see `Lessor.hear`."""
        return self.tenure is None and self.lessor.outranked

    def petition(self, petition: Petition) -> Tenure:
        """Grant the lease, or refuse: see `Lessor.petition`."""
        self._tick()
        tenure = self.lessor.petition(
            petition.parent,
            petition.slot,
            petition.lineage,
            petition.term,
            now=_now(),
            unix=self._unix(),
            key=petition.key,
        )
        self._quiet()
        self._set_timer()
        self._watching = asyncio.get_running_loop().create_task(self._watch(tenure.parent))
        return tenure

    def renew(self, renewal: Renew) -> Tenure:
        """Prolong the lease, or refuse: see `Lessor.renew`."""
        self._tick()
        before = self.lessor.tenure
        try:
            return self.lessor.renew(
                renewal.parent, renewal.epoch, renewal.lineage, now=_now(), unix=self._unix()
            )
        except CycleOfBonds as error:
            self._ended(before, str(error))
            raise

    def release(self, parent: Address, epoch: int) -> None:
        """End the lease on its parent's word; if it is another one, nothing happens."""
        ended = self.lessor.release(parent, epoch, unix=self._unix())
        self._ended(ended, f"{parent.name} released it")

    def retract(self, parent: Address, key: str) -> None:
        """Undo a petition whose answer its parent never heard: see `Lessor.retract`."""
        ended = self.lessor.retract(parent, key, unix=self._unix())
        self._ended(ended, f"{parent.name} did not hear that it was granted")

    def close(self) -> None:
        """Stop watching; the lease ends without a word."""
        self.lessor.end(self._unix())
        self._quiet()

    def _tick(self) -> None:
        if (obeyed := self._obeyed()) is not None:
            self.lessor.hear(obeyed)
        ended = self.lessor.tick(_now(), self._unix())
        if ended is not None:
            self._ended(ended, f"{ended.parent.name} fell silent")

    def _ring(self) -> None:
        self._tick()
        self._set_timer()

    def _set_timer(self) -> None:
        tenure = self.lessor.tenure
        if tenure is not None:
            self._timer = asyncio.get_running_loop().call_at(tenure.expires, self._ring)

    def _ended(self, tenure: Tenure | None, reason: str) -> None:
        if tenure is not None:
            self._quiet()
            self._on_end(tenure, reason)

    def _quiet(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._watching is not None:
            self._watching.cancel()

    async def _watch(self, parent: Address) -> None:
        """End the lease when its parent's presence goes."""
        gone = asyncio.Event()
        try:
            registration = await self._transport.watch(
                parent.key, lambda _, there: None if there else gone.set()
            )
        except VrError:  # then the term alone decides
            return
        try:
            await gone.wait()
        finally:
            await registration.close()
        self._watching = None
        self._ended(self.lessor.end(self._unix()), f"{parent.name} has ended")


def _now() -> float:
    return asyncio.get_running_loop().time()
