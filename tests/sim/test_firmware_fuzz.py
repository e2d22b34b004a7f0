"""No message, whatever its fields hold, raises or makes the arm leap."""

from __future__ import annotations

import math

import numpy as np
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol import Frame, Parser
from robotree.protocol.dialect.table import definitions
from robotree.protocol.messages import (
    AnyMessage,
    CommandCancel,
    CommandInt,
    CommandLong,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    MavCmd,
    ParamRequestRead,
    ParamSet,
    SetMode,
    Setpoint,
    SetpointKind,
    Timesync,
    Verb,
)
from robotree.sim.arm.tuning import PARAMETERS
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
    st.builds(
        CommandLong,
        target_system=st.just(1) | BYTES,
        target_component=st.just(1) | BYTES,
        command=st.sampled_from(MavCmd) | st.integers(0, 65535),
        confirmation=BYTES,
        **{f"param{i}": WILD for i in range(1, 8)},
    ),
    st.builds(
        CommandInt,
        target_system=st.just(1),
        target_component=st.just(1),
        frame=BYTES,
        command=st.sampled_from(MavCmd),
        current=BYTES,
        autocontinue=BYTES,
        **{f"param{i}": WILD for i in range(1, 5)},
        x=st.integers(-(2**31), 2**31 - 1),
        y=st.integers(-(2**31), 2**31 - 1),
        z=WILD,
    ),
    st.builds(CommandCancel, target_system=BYTES, target_component=BYTES, command=st.sampled_from(MavCmd)),
    st.builds(
        ParamSet,
        target_system=st.just(1),
        target_component=st.just(1),
        param_id=st.sampled_from([each.name for each in PARAMETERS]) | st.text(max_size=4),
        param_value=WILD,
        param_type=st.just(9) | BYTES,
    ),
    st.builds(
        ParamRequestRead,
        target_system=st.just(1),
        target_component=st.just(1),
        param_id=st.text(max_size=4),
        param_index=st.integers(-(2**15), 2**15 - 1),
    ),
    st.builds(
        Setpoint,
        time_boot_ms=st.just(0) | WORDS,
        epoch=st.just(0),
        number=WORDS,
        args=st.tuples(*[WILD] * 7),
        ttl_ms=st.integers(0, 65535),
        target_system=st.just(1),
        target_component=st.just(1),
        kind=st.sampled_from(SetpointKind) | BYTES,
    ),
    st.builds(Timesync, tc1=st.integers(-(2**63), 2**63 - 1), ts1=st.integers(-(2**63), 2**63 - 1)),
)


@given(msgid=st.sampled_from(sorted(definitions())), payload=st.binary(min_size=1, max_size=255))
@settings(max_examples=400, deadline=None)
def test_any_payload_of_any_message_leaves_the_arm_sane(msgid: int, payload: bytes) -> None:
    """Whatever the bytes are, longer or shorter than the message too; as they would come over a link."""
    body = bytes((len(payload), 0, 0, 0, 255, 190)) + msgid.to_bytes(3, "little") + payload
    checksum = mcrf4xx(body + bytes((definitions()[msgid].crc_extra,)))
    for frame in Parser().feed(b"\xfd" + body + checksum.to_bytes(2, "little")):
        ARM.controller.post(frame, "a stranger")
    for outgoing in ARM.controller.advance():
        Frame.of(outgoing.message)
    assert np.isfinite(ARM.world.arm.state().q).all()
    assert np.abs(ARM.world.cell.data.qvel[:6]).max() < 3.0


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
