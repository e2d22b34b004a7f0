"""The two ends of a bond: the lease of the child, and the slot of its parent."""

from __future__ import annotations

import itertools

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.errors import (
    CycleOfBonds,
    LeaseDenied,
    NoSuchSlot,
    NotInControl,
    OldParent,
    Retracted,
    SlotEmpty,
    SlotOccupied,
    StaleEpoch,
)
from robotree.vr.base.principal import Principal
from robotree.vr.core.bonds import MOST_RETRACTED, Bond, GrantedLease, HeldLease, Slots

LEVER = Address("robot", "lever", "1")
OTHER = Address("robot", "other", "1")
BORN = 1_000.0
ARM = Address("robot", "arm-1", "1")
SPARE = Address("robot", "arm-2", "1")


@pytest.fixture
def child() -> GrantedLease:
    return free_lease()


def free_lease() -> GrantedLease:
    return GrantedLease.free("mover", term=5.0, unix=BORN)


def grant(
    child: GrantedLease,
    parent: Address = LEVER,
    *,
    now: float = 0.0,
    slot: str = "mover",
    wanted: float = 5.0,
) -> int:
    return child.petition(parent, slot, (parent.name,), wanted, now=now, unix=BORN + now).epoch


def test_a_silent_parent_loses_the_robot_when_the_term_is_over(child: GrantedLease) -> None:
    grant(child)
    assert child.tick(4.999, BORN) is None
    ended = child.tick(5.0, BORN)
    assert ended is not None
    assert ended.parent == LEVER
    assert child.current is None


def test_a_bond_survives_another_incarnation_of_the_parent_that_knows_its_epoch() -> None:
    child, next_life = free_lease(), Address("robot", "lever", "2")
    epoch = grant(child)
    with pytest.raises(StaleEpoch):
        child.renew(next_life, epoch - 1, ("lever",), now=1.0)
    assert child.renew(next_life, epoch, ("lever",), now=1.0).parent == next_life
    child.check(epoch, 1.0)
    with pytest.raises(StaleEpoch):
        child.renew(OTHER, epoch, ("other",), now=1.0)


@pytest.mark.parametrize("life", [1, 2, 3])
def test_the_next_process_of_a_parent_holds_the_robot_only_if_it_is_a_later_one(life: int) -> None:
    child, first, heir = free_lease(), holder(1), holder(2)
    lease = child.petition(LEVER, "mover", ("lever",), 5.0, now=0.0, unix=BORN, principal=first)
    child.promise(10.0, 2)
    child.renew(LEVER, lease.epoch, ("lever",), now=1.0, principal=first, life=2)
    child.wait_for(LEVER, 2.0)
    if life > 2:
        assert child.renew(LEVER, lease.epoch, ("lever",), now=3.0, principal=heir, life=life).life == life
        return
    with pytest.raises(OldParent, match=f"start 2 of the host of lever, and this is start {life}"):
        child.renew(LEVER, lease.epoch, ("lever",), now=3.0, principal=heir, life=life)
    child.tick(13.0, BORN)
    with pytest.raises(OldParent):
        child.expect_later(LEVER, heir, life)
    child.expect_later(OTHER, heir, life)


def holder(process: int) -> Principal:
    return Principal(user="anna", process=process, agent=LEVER.key)


def test_a_late_petition_of_an_earlier_incarnation_does_not_take_the_robot(child: GrantedLease) -> None:
    epoch = grant(child, Address("robot", "lever", "2"))
    with pytest.raises(LeaseDenied):
        grant(child, LEVER, now=1.0)
    child.check(epoch, 1.0)


def test_a_parent_that_renews_keeps_the_robot(child: GrantedLease) -> None:
    epoch = grant(child)
    for now in range(1, 100):
        assert child.renew(LEVER, epoch, ("lever",), now=float(now)).epoch == epoch
    assert child.tick(103.9, BORN) is None


def test_the_child_decides_the_term(child: GrantedLease) -> None:
    grant(child, wanted=60.0)
    assert child.term_granted == 5.0
    child.end(BORN)
    grant(child, wanted=1.0)
    assert child.term_granted == 1.0


def test_a_petition_taken_back_is_undone_whether_it_came_or_not(child: GrantedLease) -> None:
    granted = child.petition(LEVER, "mover", ("lever",), 5.0, now=0.0, unix=BORN, key="k1")
    assert child.retract(OTHER, "k1", unix=BORN) is None, "it is not the other's to take back"
    assert child.retract(LEVER, "k1", unix=BORN) == granted
    assert child.retract(LEVER, "k1", unix=BORN) is None
    child.retract(LEVER, "k2", unix=BORN)
    for key in ("k1", "k2"):
        with pytest.raises(Retracted, match="lever has taken back its petition for mover"):
            child.petition(LEVER, "mover", ("lever",), 5.0, now=0.0, unix=BORN, key=key)
    again = child.petition(LEVER, "mover", ("lever",), 5.0, now=0.0, unix=BORN, key="k3")
    assert child.retract(LEVER, "k2", unix=BORN) is None
    assert child.current == again
    assert child.retract(LEVER, "", unix=BORN) is None
    grant(child)
    for number in range(MOST_RETRACTED + 1):
        child.retract(LEVER, f"old {number}", unix=BORN)
    assert len(child.retracted) == MOST_RETRACTED


def test_a_second_parent_is_told_of_the_first(child: GrantedLease) -> None:
    grant(child)
    with pytest.raises(
        LeaseDenied, match=r"mover is already enslaved by lever; .*`robotree release lever.mover`"
    ):
        grant(child, OTHER)
    with pytest.raises(LeaseDenied):
        grant(child, LEVER, slot="second")


def test_a_petition_sent_twice_is_granted_anew(child: GrantedLease) -> None:
    first = grant(child)
    second = grant(child, now=1.0)
    assert second > first
    with pytest.raises(StaleEpoch):
        child.check(first, 0.0)
    child.check(second, 0.0)


def test_a_lease_that_is_over_cannot_be_renewed_even_before_anybody_noticed(child: GrantedLease) -> None:
    epoch = grant(child)
    with pytest.raises(StaleEpoch):
        child.renew(LEVER, epoch, ("lever",), now=5.0)
    assert child.tick(5.0, BORN) is not None
    assert child.current is None


def test_epochs_grow_with_each_grant_and_each_end(child: GrantedLease) -> None:
    seen = [child.epoch]
    for _ in range(3):
        seen.append(grant(child))
        child.end(BORN)
        seen.append(child.epoch)
    assert seen == sorted(set(seen))


def test_a_later_incarnation_begins_above_all_epochs_of_an_earlier_one(child: GrantedLease) -> None:
    """Unless it was granted more than once a second for all its life."""
    for now in range(1, 100):
        grant(child, now=float(now))
        child.end(BORN + now)
    assert GrantedLease.free("mover", unix=BORN + 200).epoch > child.epoch


def test_whose_clock_was_set_back_goes_above_what_the_controller_obeys(child: GrantedLease) -> None:
    ahead = child.epoch + 3600
    child.note_obeyed(ahead)
    assert child.epoch > ahead, "an operator commands a free robot under it"
    known = child.epoch
    child.note_obeyed(known)
    assert child.epoch == known, "the controller has obeyed it: it is our own"
    assert grant(child) > ahead
    own = free_lease()
    born = own.epoch
    own.note_obeyed(born)
    assert own.epoch == born, "the same epoch is our own, come back"


def test_a_lease_keeps_its_epoch_though_the_controller_obeys_a_later_one() -> None:
    for helps in (grant, lambda child: child.end(BORN)):
        child = free_lease()
        epoch = grant(child)
        child.note_obeyed(epoch + 3600)
        child.check(epoch, 0.0)
        assert child.epoch == epoch, "its commands are refused down there"
        helps(child)
        assert child.epoch > epoch + 3600, "to ask again helps, and so does the end of it"


def test_an_epoch_that_goes_above_ours_is_left_alone_until_a_parent_asks(child: GrantedLease) -> None:
    """Somebody else has it from another proxy of the same controller."""
    child.note_obeyed(0)
    theirs = child.epoch + 1000
    child.note_obeyed(theirs)
    assert child.outranked
    assert child.epoch < theirs
    for later in (theirs, theirs + 1, theirs + 500):
        child.note_obeyed(later)
    assert child.outranked
    assert grant(child) > theirs + 500
    assert not child.outranked


def test_the_end_of_a_lease_goes_not_above_somebody_elses(child: GrantedLease) -> None:
    child.note_obeyed(0)
    child.note_obeyed(grant(child) + 1000)
    before = child.epoch
    child.end(BORN + 5000)
    assert child.epoch > before
    assert child.outranked


def test_who_may_command(child: GrantedLease) -> None:
    child.check(None, 0.0)
    with pytest.raises(StaleEpoch):
        child.check(child.epoch, 0.0)  # an epoch is a parent's, and there is none
    epoch = grant(child)
    child.check(epoch, 0.0)
    with pytest.raises(NotInControl, match=r"mover is commanded by lever; .*`robotree release lever.mover`"):
        child.check(None, 0.0)
    with pytest.raises(StaleEpoch):
        child.check(epoch - 1, 0.0)
    child.release(LEVER, epoch, unix=BORN)
    child.check(None, 0.0)
    with pytest.raises(StaleEpoch):
        child.check(epoch, 0.0)


def test_only_the_holder_can_release(child: GrantedLease) -> None:
    epoch = grant(child)
    assert child.release(OTHER, epoch, unix=BORN) is None
    assert child.release(LEVER, epoch - 1, unix=BORN) is None
    assert child.current is not None
    assert child.release(LEVER, epoch, unix=BORN) is not None
    assert child.release(LEVER, epoch, unix=BORN) is None


def test_nobody_is_bound_to_itself_or_to_a_descendant(child: GrantedLease) -> None:
    with pytest.raises(CycleOfBonds, match=r"mover cannot enslave mover"):
        child.petition(Address("robot", "mover", "1"), "slot", ("mover",), 5.0, now=0, unix=BORN)
    with pytest.raises(CycleOfBonds, match=r"lever cannot enslave mover: .*\(top > mover > lever\)"):
        child.petition(LEVER, "slot", ("top", "mover", "lever"), 5.0, now=0, unix=BORN)
    assert child.current is None


def test_a_cycle_that_closed_elsewhere_opens_at_the_next_renewal(child: GrantedLease) -> None:
    epoch = grant(child)
    with pytest.raises(CycleOfBonds):
        child.renew(LEVER, epoch, ("mover", "lever"), now=1.0)
    assert child.current is not None, "a refusal changes nothing: the agent ends the lease"


# -- the parent's side -----------------------------------------------------------------------------


def test_a_parent_that_waited_for_its_child_has_it_again_with_the_first_grant() -> None:
    """A restored parent believes a lease for longer than it was granted, until the child answers."""
    lease = HeldLease.begin(epoch=1, term=5.0, sent=0.0, now=0.1)
    lease.confirmed = 25.0
    lease.granted(sent=20.0, now=20.1, term=5.0)
    assert lease.confirmed == 20.0
    lease.granted(sent=19.0, now=20.2, term=5.0)
    assert lease.confirmed == 20.0, "an older grant takes nothing back"


def test_the_parent_counts_from_when_it_asked() -> None:
    lease = HeldLease.begin(epoch=1, term=5.0, sent=10.0, now=12.0)
    assert lease.expires == 15.0


def test_on_a_quick_way_a_third_of_the_term_passes_between_renewals() -> None:
    lease = HeldLease.begin(epoch=1, term=6.0, sent=0.0, now=0.001)
    assert lease.due == pytest.approx(2.0)


def test_on_a_slow_way_renewals_leave_sooner() -> None:
    lease = HeldLease.begin(epoch=1, term=6.0, sent=0.0, now=0.6)
    assert lease.due < 1.0


def test_a_late_answer_is_asked_for_again_before_the_lease_ends() -> None:
    lease = HeldLease.begin(epoch=1, term=6.0, sent=0.0, now=0.1)
    asked = []
    while lease.due < lease.expires:
        asked.append(lease.due)
        lease.asked(lease.due)
    assert len(asked) >= 4
    assert all(later - sooner > 0.599 for sooner, later in itertools.pairwise(asked))


def test_grants_that_overtake_each_other_never_shorten_the_lease() -> None:
    lease = HeldLease.begin(epoch=1, term=5.0, sent=0.0, now=0.1)
    lease.asked(1.0)
    lease.asked(2.0)
    lease.granted(sent=2.0, now=2.5, term=5.0)
    lease.granted(sent=1.0, now=2.6, term=5.0)
    assert lease.expires == 7.0


def test_a_way_of_one_second_each_way_is_quick_enough_for_the_default_term() -> None:
    """Simulated: answers come 2 s later, the parent's own belief must never run out."""
    lease = HeldLease.begin(epoch=1, term=5.0, sent=0.0, now=2.0)
    out: list[float] = []
    now = 2.0
    while now < 120.0:
        while out and out[0] + 2.0 <= now:
            lease.granted(sent=out.pop(0), now=now, term=5.0)
        assert now < lease.expires
        if now >= lease.due:
            lease.asked(now)
            out.append(now)
        now += 0.01


# -- slots -----------------------------------------------------------------------------------------


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
        children.begin("left", SPARE)
    children.bind("left", bond())
    with pytest.raises(SlotOccupied):
        children.begin("left", SPARE)


def test_a_refused_child_leaves_the_slot_as_it_was() -> None:
    children = slots()
    children.begin("left", ARM)
    children.abort("left")
    assert children["left"].state == "empty"
    children.begin("left", SPARE)


def test_a_bond_is_with_a_child_in_any_incarnation_but_only_the_present_one_can_be_lost() -> None:
    children, before, after = bound(epoch=7), ARM, Address("robot", "arm-1", "2")
    held = children.held("left", after, 7)
    assert held is not None
    assert children.held("left", after, 8) is None
    assert children.held("left", SPARE, 7) is None
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
    children.begin("left", SPARE)
    children.bind("left", bond(SPARE))
    assert [spec.lost for spec in children.specs()] == ["", ""]
    assert children.require("left").child == SPARE


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
        children.bind("left", bond(SPARE))
