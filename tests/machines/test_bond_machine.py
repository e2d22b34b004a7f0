"""Child slots against a model that is one dictionary per slot."""

from __future__ import annotations

import hypothesis.strategies as st
import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.errors import NoSuchSlot, SlotEmpty, SlotOccupied
from robotree.vr.core.bonds import Bond, HeldLease, Slots
from tests.machines.checkpoint import decoded

NAMES = ("left", "right")
CHILDREN = [Address("robot", f"arm-{number}", "1") for number in range(3)]
slot_names = st.sampled_from(NAMES)


class BondMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.epoch = 0
        self.slots = Slots.empty("lever", [SlotSpec(name=name, kind="Arm") for name in NAMES])
        self.asked: dict[str, Address] = {}
        self.bound: dict[str, Bond] = {}
        self.lost: dict[str, str] = {}
        self.former: list[tuple[str, Bond]] = []

    @rule()
    def go_on_from_the_encoded_state(self) -> None:
        self.slots = decoded(self.slots)

    @rule(slot=slot_names, child=st.sampled_from(CHILDREN))
    def begin(self, slot: str, child: Address) -> None:
        if slot in self.asked or slot in self.bound:
            with pytest.raises(SlotOccupied):
                self.slots.begin(slot, child)
        else:
            self.slots.begin(slot, child)
            self.asked[slot] = child

    @precondition(lambda self: self.asked)
    @rule(data=st.data())
    def bind(self, data: st.DataObject) -> None:
        slot = data.draw(st.sampled_from(sorted(self.asked)))
        child = self.asked.pop(slot)
        self.epoch += 1
        lease = HeldLease.begin(epoch=self.epoch, term=5.0, sent=0.0, now=0.0)
        bond = Bond(child=child, lease=lease, description=RobotDescription(address=child, kinds=("Arm",)))
        self.slots.bind(slot, bond)
        self.bound[slot] = bond
        self.lost.pop(slot, None)

    @precondition(lambda self: self.asked)
    @rule(data=st.data())
    def abort(self, data: st.DataObject) -> None:
        slot = data.draw(st.sampled_from(sorted(self.asked)))
        del self.asked[slot]
        self.slots.abort(slot)

    @rule(slot=slot_names)
    def free(self, slot: str) -> None:
        if slot in self.bound:
            bond = self.bound.pop(slot)
            assert self.slots.free(slot) == bond
            self.former.append((slot, bond))
        else:
            with pytest.raises(SlotEmpty):
                self.slots.free(slot)

    @rule(slot=slot_names, reason=st.sampled_from(["it died", "it is silent"]))
    def lose(self, slot: str, reason: str) -> None:
        if slot in self.bound:
            bond = self.bound.pop(slot)
            assert self.slots.lose(slot, bond.child, bond.lease.epoch, reason)
            self.lost[slot] = reason
            self.former.append((slot, bond))

    @precondition(lambda self: self.former)
    @rule(data=st.data())
    def late_news_of_a_former_bond(self, data: st.DataObject) -> None:
        slot, bond = data.draw(st.sampled_from(self.former))
        assert not self.slots.lose(slot, bond.child, bond.lease.epoch, "late")

    @rule()
    def ask_for_a_slot_that_is_not(self) -> None:
        with pytest.raises(NoSuchSlot):
            self.slots.begin("middle", CHILDREN[0])

    @invariant()
    def what_is_seen_is_what_is(self) -> None:
        for spec in self.slots.specs():
            bond = self.bound.get(spec.name)
            assert spec.child == (None if bond is None else bond.child)
            assert spec.lost == self.lost.get(spec.name, "")
            state = "bound" if bond else "asking" if spec.name in self.asked else "empty"
            assert self.slots[spec.name].state == state
        assert self.slots.bonds() == self.bound
        assert sorted(self.slots.children()) == sorted(
            [*self.asked.values(), *(bond.child for bond in self.bound.values())]
        )

    @invariant()
    def only_a_bound_slot_can_be_used(self) -> None:
        for name in NAMES:
            if name in self.bound:
                assert self.slots.require(name) == self.bound[name]
            else:
                with pytest.raises(SlotEmpty) as refused:
                    self.slots.require(name)
                assert self.lost.get(name, "") in refused.value.data["reason"]


TestBondMachine = BondMachine.TestCase
TestBondMachine.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)
