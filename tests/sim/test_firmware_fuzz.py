"""No message, whatever its fields hold, raises or makes the arm leap."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.messages import (
    AnyMessage,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    SetMode,
    Timesync,
    Verb,
)
from robotree.sim.testing import ArmBench

BYTES = st.integers(0, 255)
WORDS = st.integers(0, 2**32 - 1)
WILD = st.floats(width=32) | st.sampled_from((0.3, -0.3, 0.05, 1e30, math.nan, math.inf, -math.inf))
ARM = ArmBench()

messages = st.one_of(
    st.builds(
        Goal,
        key=st.integers(0, 2**64 - 1),
        epoch=st.just(0),
        ttl_ms=WORDS,
        args=st.tuples(*[WILD] * 7),
        verb=st.sampled_from(Verb) | st.integers(0, 65535),
        target_system=st.just(1) | BYTES,
        target_component=st.just(1) | BYTES,
    ),
    st.builds(
        GoalCancel,
        key=st.integers(0, 2**64 - 1),
        epoch=WORDS,
        target_system=BYTES,
        target_component=BYTES,
    ),
    st.builds(SetMode, epoch=st.just(0), target_system=BYTES, target_component=BYTES, mode=BYTES),
    st.builds(Timesync, tc1=st.integers(-(2**63), 2**63 - 1), ts1=st.integers(-(2**63), 2**63 - 1)),
)


@given(message=messages, system=st.integers(1, 255))
@settings(max_examples=300, deadline=None)
def test_any_message_leaves_the_arm_sane(message: AnyMessage, system: int) -> None:
    ARM.controller.post(Frame.of(message, system=system), "a stranger")
    out = ARM.controller.advance()
    for outgoing in out:
        Frame.of(outgoing.message)
    refused = [m.message for m in out if isinstance(m.message, GoalStatus)]
    assert all(status.text or status.state != GoalState.REFUSED for status in refused)
    state = ARM.world.arm.state()
    assert np.isfinite(state.q).all()
    assert np.abs(ARM.world.cell.data.qvel[:6]).max() < 3.0
