"""Bonds from the parent's side: its child slots, and what is in them.

*To enslave* a robot is to bind it to a slot: from then on its parent alone commands it, as long as it keeps
renewing the lease. Pure: nothing here asks or tells anyone.

    empty ── begin ──► asking ── bind ──► bound
      ▲                  │ abort            │ free, lose
      └──────────────────┴──────────────────┘
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import msgspec

from robotree.vr.address import Address
from robotree.vr.core.lease import Lessee
from robotree.vr.description import RobotDescription, SlotSpec
from robotree.vr.errors import NoSuchSlot, SlotEmpty, SlotOccupied


class Bond(msgspec.Struct, kw_only=True):
    """A child in a slot, with the lease on it."""

    child: Address
    lease: Lessee
    description: RobotDescription
    """As the child last gave it."""
    depth: int = 0
    """Levels of robots below the child, as it said last."""
    ways: float = 0.0
    """[s] that the ways down through these levels and back take together, as it said last."""


class Slot(msgspec.Struct):
    """One slot. Its state follows from what is in it."""

    spec: SlotSpec
    asked: Address | None = None
    """The child that is being asked."""
    bond: Bond | None = None
    lost: str = ""
    """Why the last child was lost; empty: it was not."""

    @property
    def state(self) -> Literal["empty", "asking", "bound"]:
        """Where it is in its life."""
        if self.bond is not None:
            return "bound"
        return "empty" if self.asked is None else "asking"

    @property
    def child(self) -> Address | None:
        """Who is in it, or is being asked."""
        return self.asked if self.bond is None else self.bond.child


class Slots(msgspec.Struct):
    """All slots of one virtual robot, by name."""

    robot: str
    """Name of the virtual robot, for messages."""
    by_name: dict[str, Slot] = {}

    @classmethod
    def empty(cls, robot: str, specs: Iterable[SlotSpec]) -> Slots:
        """Begin with nobody in them.

        Args:
            robot: name of the virtual robot.
            specs: the slots that its class declares.
        """
        return cls(robot, {spec.name: Slot(spec) for spec in specs})

    def __getitem__(self, name: str) -> Slot:
        """Return a slot.

        Raises:
            NoSuchSlot: there is none of this name.
        """
        try:
            return self.by_name[name]
        except KeyError:
            known = ", ".join(self.by_name) or "none"
            raise NoSuchSlot(robot=self.robot, slot=name, known=known) from None

    def specs(self) -> tuple[SlotSpec, ...]:
        """Describe the slots and what is in them."""
        return tuple(
            msgspec.structs.replace(
                slot.spec, child=None if slot.bond is None else slot.bond.child, lost=slot.lost
            )
            for slot in self.by_name.values()
        )

    def bonds(self) -> dict[str, Bond]:
        """Return the bonds in force, by slot."""
        return {name: slot.bond for name, slot in self.by_name.items() if slot.bond is not None}

    def children(self) -> list[Address]:
        """Return who is bound or is being asked."""
        return [slot.child for slot in self.by_name.values() if slot.child is not None]

    def require(self, name: str) -> Bond:
        """Return the bond in a slot.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nobody is in it, and why.
        """
        slot = self[name]
        if slot.bond is None:
            raise self.emptiness(name)
        return slot.bond

    def emptiness(self, name: str) -> SlotEmpty:
        """Return the error for an empty slot, with the reason."""
        slot = self[name]
        reason = slot.lost or ("its child is just being asked" if slot.asked else "no child was bound to it")
        return SlotEmpty(robot=self.robot, slot=name, reason=reason, kind=slot.spec.kind)

    def begin(self, name: str, child: Address) -> Slot:
        """Reserve an empty slot while the child is being asked.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotOccupied: somebody is in it or is being asked.
        """
        slot = self[name]
        if slot.child is not None:
            raise SlotOccupied(robot=self.robot, slot=name, child=slot.child.name)
        slot.asked = child
        return slot

    def bind(self, name: str, bond: Bond) -> None:
        """Fill the slot with the child that was asked."""
        slot = self[name]
        if slot.asked != bond.child:
            msg = f"{bond.child} was not asked to come into {self.robot}.{name}"
            raise ValueError(msg)
        slot.asked, slot.bond, slot.lost = None, bond, ""

    def abort(self, name: str) -> None:
        """Take the question back: the child refused or did not answer."""
        self[name].asked = None

    def held(self, name: str, child: Address, epoch: int) -> Bond | None:
        """Return the bond in a slot if it is the one with this child and epoch."""
        bond = self[name].bond
        return bond if bond is not None and (bond.child, bond.lease.epoch) == (child, epoch) else None

    def lose(self, name: str, child: Address, epoch: int, reason: str) -> bool:
        """Empty the slot because the child is lost.

        Args:
            name: the slot.
            child: that is lost.
            epoch: of the bond that is lost; if the slot holds another one by now, nothing happens.
            reason: why, for everybody who uses the slot from now on.

        Returns:
            Whether the slot has been emptied.
        """
        if self.held(name, child, epoch) is None:
            return False
        self[name].bond, self[name].lost = None, reason
        return True

    def free(self, name: str) -> Bond:
        """Empty the slot on request and return what was in it.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nothing was in it.
        """
        bond = self.require(name)
        self[name].bond, self[name].lost = None, ""
        return bond
