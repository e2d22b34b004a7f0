"""Who commands a robot is the same one after it has moved to another site, named as it is seen there."""

from __future__ import annotations

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.errors import OldParent
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.machine import AcceptedCall, Calls, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.journal.recovery import see_from

LEVER = Address("robot", "lever", "1")
NEAR = Principal(user="anna", process=7, agent=LEVER.key)
FAR = Principal(user="anna", process=7, agent=LEVER.key, site="desk")
HOST = Principal(user="anna", process=7, agent="host/host-1/1", site="desk")


def state_of(holder: Principal) -> RobotState:
    lease = GrantedLease.free("mover", unix=1e9)
    lease.petition(LEVER, "mover", ("lever",), 5.0, now=0.0, unix=1e9, principal=holder)
    lease.promise(10.0, 1)
    calls = Calls()
    for key, principal in (("its", holder), ("own", ITSELF)):
        calls.live[key] = AcceptedCall(key=key, command="go", sent={}, arguments={}, principal=principal)
    return RobotState(
        address=Address("robot", "mover", "1"),
        home="",
        lease=lease,
        slots=Slots("mover"),
        calls=calls,
        stop=Stop(),
    )


def test_its_parent_at_the_site_that_it_left_renews_its_lease_from_there() -> None:
    state = state_of(NEAR)
    epoch = state.lease.epoch
    with pytest.raises(OldParent):  # as another process of the parent, which it is not
        state.lease.renew(LEVER, epoch, ("lever",), now=1.0, unix=1e9, principal=FAR, life=1)
    see_from(state, HOST, "plant")
    state.lease.renew(LEVER, epoch, ("lever",), now=1.0, unix=1e9, principal=FAR, life=1)
    assert state.lease.epoch == epoch
    assert [call.principal for call in state.calls.live.values()] == [FAR, ITSELF]


def test_a_parent_at_the_site_to_which_it_comes_is_near_then_and_one_at_a_third_stays_where_it_is() -> None:
    state = state_of(FAR)
    see_from(state, Principal(user="bob", process=9, agent="host/host-2/1", site="plant"), "desk")
    assert state.lease.current is not None
    assert state.lease.current.principal == NEAR
    yard = Principal(user="anna", process=7, agent=LEVER.key, site="yard", roles=("maker",))
    third = state_of(yard)
    see_from(third, HOST, "plant")
    assert third.lease.current is not None
    assert third.lease.current.principal == yard


def test_who_sits_at_the_machine_of_a_person_is_that_person_there() -> None:
    state = state_of(NEAR)
    see_from(
        state,
        Principal(user="cleo", process=7, agent="host/h/1", site="cleo", member=True, roles=("a",)),
        "plant",
    )
    assert state.lease.current is not None
    assert state.lease.current.principal == Principal(
        user="cleo", process=7, agent=LEVER.key, site="cleo", member=True, roles=("a",)
    )
