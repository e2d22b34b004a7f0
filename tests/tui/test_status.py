"""How a robot is: one ladder of states, for every source and every reader."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.seen import status
from robotree.tui.seen.status import Status
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription
from robotree.vr.base.requests import State

PARENT = Address("robot", "mover", "1")

STATES = st.builds(
    State,
    busy=st.sampled_from(["", "go_to"]),
    waiting=st.integers(0, 2),
    online=st.booleans(),
    stopped=st.booleans(),
    abandoned=st.sampled_from([(), ("defy",)]),
    bond=st.sampled_from([None, PARENT]),
    paused=st.sampled_from(["", "anna@pts/3"]),
    held=st.sampled_from(["", "step 2: arm.hold()"]),
)


@given(state=STATES)
def test_a_state_and_a_description_of_the_same_robot_say_the_same(state: State) -> None:
    described = RobotDescription(
        address=Address("robot", "arm-1", "1"),
        kinds=("Arm",),
        busy=state.busy,
        waiting=state.waiting,
        online=state.online,
        stopped=state.stopped,
        abandoned=state.abandoned,
        paused=state.paused,
        held=state.held,
        bond=BondSpec(parent=PARENT, slot="arm", epoch=1, remaining=5) if state.bond else None,
    )
    assert status.status_of(described) == status.status_of(state)
    assert status.words(described) == status.words(state)


@given(state=STATES, share=st.one_of(st.none(), st.floats()))
def test_only_calm_robots_need_no_word(state: State, share: float | None) -> None:
    calm = status.status_of(state) in status.CALM
    assert calm == (status.words(state) in status.CALM)
    left_out = state.stopped or state.abandoned or state.busy or state.paused
    assert calm == (state.online and not left_out), "trouble and work are never left out"
    assert "nan" not in status.doing(state, share)
    assert "inf" not in status.doing(state, share)


@pytest.mark.parametrize(
    ("state", "one", "beside_a_sign", "alone"),
    [
        (State(), "free", "free", "free"),
        (State(busy="go_to", waiting=2), "busy", "go_to 40 % +2", "busy: go_to +2"),
        (State(busy="go_to", abandoned=("defy",)), "abandoned", *["ABANDONED: defy still runs"] * 2),
        (
            State(busy="move", paused="anna@pts/3", held="step 2: arm.hold()"),
            "paused",
            *["paused before step 2: arm.hold()"] * 2,
        ),
        (State(busy="move", paused="anna@pts/3"), "paused", *["paused: move"] * 2),
        (State(away=6.6), "waits", *["its parent is away, 7 s left"] * 2),
        (State(stopped=True, paused="anna@pts/3"), "stopped", "stopped", "STOPPED"),
        (State(stopped=True, abandoned=("defy",)), "stopped", "stopped", "STOPPED"),
        (State(online=False, stopped=True), "offline", "offline", "offline"),
    ],
)
def test_what_matters_most_comes_first(state: State, one: Status, beside_a_sign: str, alone: str) -> None:
    assert status.status_of(state) == one
    assert status.doing(state, 0.4) == beside_a_sign
    assert status.words(state) == alone
