from __future__ import annotations

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.errors import NoSuchSlot, SlotEmpty, SlotOccupied
from robotree.vr.core.bonds import Bond, HeldLease, Slots

ARM = Address("robot", "arm-1", "1")
OTHER = Address("robot", "arm-2", "1")


def slots() -> Slots:
    return Slots.empty("lever", [SlotSpec(name="left", kind="Arm"), SlotSpec(name="right", kind="Arm")])


def bond(child: Address = ARM, epoch: int = 1) -> Bond:
    lease = HeldLease.begin(epoch=epoch, term=5.0, sent=0.0, now=0.0)
    return Bond(child=child, lease=lease, description=RobotDescription(address=child, kinds=("Arm", "Robot")))


def bound(epoch: int = 1) -> Slots:
    """Return slots with an arm in the left one."""
    children = slots()
    children.begin("left", ARM)
    children.bind("left", bond(epoch=epoch))
    return children


def test_an_unknown_slot_is_answered_with_those_there_are() -> None:
    with pytest.raises(NoSuchSlot, match="lever has no child slot 'middle'; it has: left, right"):
        slots()["middle"]


def test_an_occupied_slot_names_who_is_in_it() -> None:
    children = slots()
    children.begin("left", ARM)
    with pytest.raises(SlotOccupied, match=r"lever.left already holds arm-1; release it first"):
        children.begin("left", OTHER)
    children.bind("left", bond())
    with pytest.raises(SlotOccupied):
        children.begin("left", OTHER)


def test_a_refused_child_leaves_the_slot_as_it_was() -> None:
    children = slots()
    children.begin("left", ARM)
    children.abort("left")
    assert children["left"].state == "empty"
    children.begin("left", OTHER)


def test_a_bond_is_with_a_child_in_any_incarnation_but_only_the_present_one_can_be_lost() -> None:
    children, before, after = bound(epoch=7), ARM, Address("robot", "arm-1", "2")
    held = children.held("left", after, 7)
    assert held is not None
    assert children.held("left", after, 8) is None
    assert children.held("left", OTHER, 7) is None
    held.child = after
    assert not children.lose("left", before, 7, "arm-1 has ended")
    assert children.lose("left", after, 7, "arm-1 has ended")


def test_a_lost_child_leaves_its_reason_until_the_next_one_comes() -> None:
    children = bound()
    assert children.lose("left", ARM, 1, "arm-1 has ended")
    assert [spec.lost for spec in children.specs()] == ["arm-1 has ended", ""]
    with pytest.raises(
        SlotEmpty, match=r"lever.left is empty \(arm-1 has ended\); enslave a robot of kind Arm: "
    ):
        children.require("left")
    children.begin("left", OTHER)
    children.bind("left", bond(OTHER))
    assert [spec.lost for spec in children.specs()] == ["", ""]
    assert children.require("left").child == OTHER


def test_an_old_loss_does_not_touch_a_new_bond() -> None:
    children = bound()
    children.free("left")
    children.begin("left", ARM)
    children.bind("left", bond(epoch=2))
    assert not children.lose("left", ARM, 1, "late news")
    assert children["left"].state == "bound"


def test_an_empty_slot_says_that_its_child_was_released() -> None:
    children = bound()
    assert children.free("left").child == ARM
    assert children["left"].lost == ""
    with pytest.raises(SlotEmpty, match="arm-1 was released"):
        children.free("left")


def test_only_the_child_that_was_asked_comes_in() -> None:
    children = slots()
    children.begin("left", ARM)
    with pytest.raises(ValueError, match="was not asked"):
        children.bind("left", bond(OTHER))
