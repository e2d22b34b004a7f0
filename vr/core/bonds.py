"""Bonds from the parent's side: its child slots, and what is in them.

*To enslave* a robot is to bind it to a slot: from then on its parent alone commands it, as long as it keeps
renewing the lease. Pure: nothing here asks or tells anyone.

    empty ── begin ──► asking ── bind ──► bound
      ▲                  │ abort            │ free, lose
      └──────────────────┴──────────────────┘

A *group* is an array of slots of one kind, `rovers[0]`, `rovers[1]` …, each of them a slot like any other.
Only those that matter are kept: the first that are needed, those with a child or a lost one, and the lowest
that is empty. A child keeps its index; one that is lost leaves a gap, which can be filled again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

import msgspec

from robotree.vr.address import Address
from robotree.vr.core.lease import Lessee
from robotree.vr.description import RobotDescription, SlotSpec
from robotree.vr.errors import GroupFull, NoSuchSlot, SlotEmpty, SlotHeld, SlotOccupied

_MEMBER = re.compile(r"(\w+)\[(0|[1-9]\d{0,3})]")


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
    was: str = ""
    """Name of the child that was lost."""
    released: str = ""
    """Name of the child that was released last; empty: none since the last one came."""

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
    """Replaced as a whole when a group grows or shrinks: other threads read it."""
    groups: dict[str, SlotSpec] = {}

    @classmethod
    def empty(cls, robot: str, specs: Iterable[SlotSpec]) -> Slots:
        """Begin with nobody in them.

        Args:
            robot: name of the virtual robot.
            specs: the slots and groups that its class declares.
        """
        specs = tuple(specs)
        slots = cls(robot, groups={spec.name: spec for spec in specs if spec.group})
        for spec in specs:
            if spec.group:
                slots._tidy(spec.group)
            else:
                slots.by_name[spec.name] = Slot(spec)
        return slots

    def __getitem__(self, name: str) -> Slot:
        """Return a slot.

        Raises:
            NoSuchSlot: there is none of this name.
        """
        slot = self.by_name.get(name)
        if slot is not None:
            return slot
        group, index = _member(name)
        spec = self.groups.get(group)
        if spec is None or not index < spec.most:
            known = ", ".join(self._declared()) or "none"
            raise NoSuchSlot(robot=self.robot, slot=name, known=known) from None
        return _new_member(spec, index)

    def _declared(self) -> list[str]:
        """Return the names of slots and groups, a group as `rovers[0…3]`."""
        alone = [name for name, slot in self.by_name.items() if not slot.spec.group]
        return [*alone, *(f"{name}[0…{spec.most - 1}]" for name, spec in self.groups.items())]

    def place(self, name: str, child: str) -> str:
        """Return the slot into which a child goes; only for a group there is a choice.

        Args:
            name: of a slot, or of a group: there it goes where it was lost, else into the lowest empty slot.
            child: its name.

        Raises:
            GroupFull: the group has no slot left.
        """
        if name not in self.groups:
            return name
        empty = {index: slot for index, slot in self.members(name).items() if slot.child is None}
        if not empty:
            raise GroupFull(robot=self.robot, slot=name, most=self.groups[name].most)
        index = min(empty, key=lambda index: (empty[index].was != child, index))
        return f"{name}[{index}]"

    def filled(self, name: str) -> list[str]:
        """Return the slots with children that a name means: itself, or those of the group.

        Raises:
            SlotEmpty: the group has none.
        """
        if name not in self.groups:
            return [name]
        found = [slot.spec.name for slot in self.members(name).values() if slot.bond is not None]
        if not found:
            kind, reason = self.groups[name].kind, "no child was bound to it"
            raise SlotEmpty(robot=self.robot, slot=name, reason=reason, kind=kind)
        return found

    def members(self, group: str) -> dict[int, Slot]:
        """Return the slots of a group that matter, by index."""
        found = {
            _member(name)[1]: slot for name, slot in list(self.by_name.items()) if slot.spec.group == group
        }
        return dict(sorted(found.items()))

    def _tidy(self, group: str) -> None:
        """Keep those slots of a group that matter, in order."""
        if not group:
            return
        spec = self.groups[group]
        found = {index: slot for index, slot in self.members(group).items() if slot.child or slot.lost}
        lowest = next((index for index in range(spec.most) if index not in found), None)
        for index in {*range(spec.least), *([] if lowest is None else [lowest])} - found.keys():
            found[index] = _new_member(spec, index)
        kept: dict[str, Slot] = {}
        for name, slot in [*self.by_name.items(), (group, Slot(spec))]:
            if slot.spec.group == group:
                kept |= {found[index].spec.name: found[index] for index in sorted(found)}
            else:
                kept[name] = slot
        self.by_name = kept

    def revise(self, specs: Iterable[SlotSpec]) -> None:
        """Have the slots that another page declares; children stay in those of their name.

        Args:
            specs: the slots and groups that the other page declares.

        Raises:
            SlotHeld: a slot with a child is not among them, or takes another kind; nothing has changed.
        """
        fresh = Slots.empty(self.robot, specs)
        stay: dict[str, Slot] = {}
        for name, slot in self.by_name.items():
            if slot.child is None and not slot.lost:
                continue
            same = name in fresh.by_name or _member(name)[0] in fresh.groups
            try:
                same = same and fresh[name].spec.kind == slot.spec.kind
            except NoSuchSlot:  # the group is shorter now
                same = False
            if same:
                stay[name] = slot
            elif slot.child is not None:
                raise SlotHeld(robot=self.robot, slot=name, child=slot.child.name, kind=slot.spec.kind)
        for name, slot in stay.items():
            slot.spec = fresh[name].spec
        declared = {name: stay.get(name, slot) for name, slot in fresh.by_name.items()}
        self.by_name, self.groups = {**declared, **stay}, fresh.groups
        for group in self.groups:
            self._tidy(group)

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

    @property
    def depth(self) -> int:
        """Levels of robots below: 1 with children that have none."""
        return max((1 + bond.depth for bond in self.bonds().values()), default=0)

    @property
    def ways(self) -> float:
        """[s] that the ways down to the last of those below and back take together."""
        return max((bond.lease.round_trip + bond.ways for bond in self.bonds().values()), default=0.0)

    def children(self) -> list[Address]:
        """Return who is bound or is being asked."""
        return [slot.child for slot in self.by_name.values() if slot.child is not None]

    def require(self, name: str) -> Bond:
        """Return the bond in a slot.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nobody is in it, and why.
        """
        slot = self.by_name.get(name)
        if slot is None or slot.bond is None:
            raise self.emptiness(name)
        return slot.bond

    def emptiness(self, name: str) -> SlotEmpty:
        """Return the error for an empty slot, with the reason.

        Raises:
            NoSuchSlot: there is no such slot.
        """
        slot = self[name]
        before = f"{slot.released} was released" if slot.released else "no child was bound to it"
        reason = slot.lost or ("its child is just being asked" if slot.asked else before)
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
        if name not in self.by_name:
            self.by_name = {**self.by_name, name: slot}
        self._tidy(slot.spec.group)
        return slot

    def bind(self, name: str, bond: Bond) -> None:
        """Fill the slot with the child that was asked."""
        slot = self[name]
        if slot.asked != bond.child:
            msg = f"{bond.child} was not asked to come into {self.robot}.{name}"
            raise ValueError(msg)
        slot.asked, slot.bond, slot.lost, slot.was, slot.released = None, bond, "", "", ""

    def abort(self, name: str) -> None:
        """Take the question back: the child refused or did not answer."""
        slot = self[name]
        slot.asked = None
        self._tidy(slot.spec.group)

    def held(self, name: str, child: Address, epoch: int) -> Bond | None:
        """Return the bond in a slot if it is the one with this child, in any incarnation, and epoch."""
        bond = self[name].bond
        if bond is None or (bond.child.identity, bond.lease.epoch) != (child.identity, epoch):
            return None
        return bond

    def lose(self, name: str, child: Address, epoch: int, reason: str) -> bool:
        """Empty the slot because the child is lost.

        Args:
            name: the slot.
            child: the incarnation that is lost.
            epoch: of the bond that is lost; if the slot holds another one by now, nothing happens.
            reason: why, for everybody who uses the slot from now on.

        Returns:
            Whether the slot has been emptied.
        """
        bond = self.held(name, child, epoch)
        if bond is None or bond.child != child:
            return False
        slot = self[name]
        slot.bond, slot.lost, slot.was = None, reason, child.name
        self._tidy(slot.spec.group)
        return True

    def free(self, name: str) -> Bond:
        """Empty the slot on request and return what was in it.

        Raises:
            NoSuchSlot: there is no such slot.
            SlotEmpty: nothing was in it.
        """
        bond, slot = self.require(name), self[name]
        slot.bond, slot.lost, slot.released = None, "", bond.child.name
        self._tidy(slot.spec.group)
        return bond


def _new_member(group: SlotSpec, index: int) -> Slot:
    optional = index >= group.least
    return Slot(msgspec.structs.replace(group, name=f"{group.name}[{index}]", optional=optional))


def _member(name: str) -> tuple[str, int]:
    """Return group and index of `rovers[2]`; an empty group for another name."""
    found = _MEMBER.fullmatch(name)
    return (found[1], int(found[2])) if found else ("", 0)
