"""The firmware against an opponent: whatever is asked in whatever order, its promises hold."""

from __future__ import annotations

import itertools
import math
from enum import Enum, auto

import numpy as np
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robotree.protocol import Frame, Parser
from robotree.protocol.dialect.table import definitions
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    CommandCancel,
    CommandInt,
    CommandLong,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    ParamRequestRead,
    ParamSet,
    Reason,
    SetMode,
    Setpoint,
    SetpointKind,
    Timesync,
    Verb,
)
from robotree.sim.arm.device import PARAMETERS
from robotree.sim.testing import NAN, ArmBench, Operator, RoverBench

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


class Word(Enum):
    """What somebody says in a burst."""

    STOP = auto()
    KILL = auto()
    READY = auto()
    ARM = auto()
    HOLD = auto()
    GOAL = auto()


EPOCHS = st.integers(0, 4)
KEYS = st.integers(1, 6)


class FirmwareMachine(RuleBasedStateMachine):
    """Goals, cancels, stops, releases and silence, on the rover because its physics is quick."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = RoverBench(silence=1.5)
        self.operator = self.bench.operator
        self.operators = (self.operator, self.operator.another())
        self.stopped = False
        self.read = 0
        self.highest = 0
        self.number = 0
        self.states: dict[int, GoalState] = {}
        self.keys = itertools.count(100)
        self.operator.wait(0.02)

    @rule(key=KEYS, dx=st.sampled_from((-0.1, 0.05, 9.0)), epoch=EPOCHS, ttl=st.sampled_from((0.0, 0.2)))
    def ask(self, key: int, dx: float, epoch: int, ttl: float) -> None:
        self.operator.ask(Verb.MOVE, dx, 0.0, key=key, epoch=epoch, ttl=ttl)
        self.operator.wait(0.02)

    @rule(key=st.integers(0, 6), epoch=EPOCHS)
    def cancel(self, key: int, epoch: int) -> None:
        self.operator.cancel(key, epoch)
        self.operator.wait(0.02)

    @rule(dx=st.sampled_from((-0.1, 0.05, 9.0)))
    def command(self, dx: float) -> None:
        self.operator.order(MavCmd.ROBOTREE_MOVE, dx, 0.0)
        self.operator.wait(0.02)

    @rule()
    def end_the_command(self) -> None:
        self.operator.say(CommandCancel(1, 1, MavCmd.ROBOTREE_MOVE))
        self.operator.wait(0.02)

    @rule(speed=st.sampled_from((-0.2, 0.3)), epoch=EPOCHS, count=st.integers(1, 5))
    def stream(self, speed: float, epoch: int, count: int) -> None:
        args = (speed, 0.0, *(NAN,) * 5)
        for _ in range(count):
            self.number += 1
            self.operator.say(Setpoint(0, epoch, self.number, args, 100, 1, 1, SetpointKind.BASE_VELOCITY))
            self.operator.wait(0.02)

    @rule()
    def stop_as_ground_stations_do(self) -> None:
        assert self.operator.command(MavCmd.COMPONENT_ARM_DISARM, 0.0, 21196.0).result == MavResult.ACCEPTED
        self.operator.wait(0.02)
        self.stopped = True

    @rule()
    def arm(self) -> None:
        leased = self.operator.latest(Mode).epoch > 0
        result = self.operator.command(MavCmd.COMPONENT_ARM_DISARM, 1.0).result
        self.operator.wait(0.02)
        assert result == (MavResult.TEMPORARILY_REJECTED if leased else MavResult.ACCEPTED)
        self.stopped = self.stopped and leased

    @rule()
    def stop(self) -> None:
        self.operator.set_mode(ModeKind.SAFE_STOP, epoch=0)
        self.operator.wait(0.02)
        self.stopped = True

    @rule(epoch=EPOCHS)
    def release(self, epoch: int) -> None:
        obeyed = self.operator.latest(Mode).epoch
        self.operator.set_mode(ModeKind.READY, epoch)
        self.operator.wait(0.02)
        self.stopped = self.stopped and epoch < obeyed

    @rule(words=st.lists(st.tuples(st.integers(0, 1), st.sampled_from(Word)), min_size=2, max_size=12))
    def burst(self, words: list[tuple[int, Word]]) -> None:
        """Both say many things at once; what came after the last stop of both is what counts."""
        epoch = self.operator.latest(Mode).epoch
        for who, word in words:
            self.say(self.operators[who], word, epoch)
            self.operators[who].carry()  # so that it arrives before what is said next
            if word is Word.STOP or word is Word.KILL:
                self.stopped = True
            elif word is Word.READY or (word is Word.ARM and not epoch):
                self.stopped = False
        self.operator.wait(0.05 + 0.02 * len(words))

    def say(self, operator: Operator, word: Word, epoch: int) -> None:
        match word:
            case Word.STOP:
                operator.set_mode(ModeKind.SAFE_STOP, epoch=0)
            case Word.KILL:
                operator.order(MavCmd.COMPONENT_ARM_DISARM, 0.0, 21196.0)
            case Word.READY:
                operator.set_mode(ModeKind.READY, epoch)
            case Word.ARM:
                operator.order(MavCmd.COMPONENT_ARM_DISARM, 1.0)
            case Word.HOLD:
                operator.order(MavCmd.DO_SET_MODE, 1.0, 4.0, 3.0)
            case Word.GOAL:
                operator.ask(Verb.MOVE, 0.05, 0.0, key=next(self.keys), epoch=epoch)

    @rule(seconds=st.sampled_from((0.1, 1.0, 4.0)))
    def wait(self, seconds: float) -> None:
        self.operator.wait(seconds)

    @rule()
    def fall_silent(self) -> None:
        for each in self.operators:
            each.silent = True
        self.operator.wait(2.0)
        for each in self.operators:
            each.silent = False
        assert not self.unfinished(), "silence ends every goal"

    @invariant()
    def a_stop_stays_until_it_is_released_and_nothing_moves_meanwhile(self) -> None:
        for each in self.operators:
            assert (each.mode()[0] == ModeKind.SAFE_STOP) == self.stopped, "on each link the last word counts"
        if self.stopped:
            assert not self.unfinished()

    @invariant()
    def at_most_one_goal_is_unfinished(self) -> None:
        assert len(self.unfinished()) <= 1

    @invariant()
    def the_end_of_a_goal_is_final_and_epochs_never_fall(self) -> None:
        for _, message in self.operator.heard[self.read :]:
            if isinstance(message, Mode):
                assert message.epoch >= self.highest
                self.highest = message.epoch
            if not isinstance(message, GoalStatus) or message.sequence == 0:
                continue  # without a record: about a key that was never begun
            before = self.states.get(message.key)
            if before is not None and before.final:
                assert message.state == before, f"goal {message.key} rose from the dead"
            self.states[message.key] = GoalState(message.state)
            assert message.reason == Reason.NONE or message.state >= GoalState.REFUSED
        self.read = len(self.operator.heard)

    @invariant()
    def the_mode_says_whether_something_runs_and_only_one_thing_does(self) -> None:
        active = self.operator.mode()[0] == ModeKind.ACTIVE
        runs = len(self.unfinished()) + self.commanded()
        assert runs <= 1
        assert active or not runs
        assert abs(self.bench.world.rover.state().position[0]) < 1.5, "it stays on its floor"

    def commanded(self) -> bool:
        acks = [ack for ack in self.operator.all(CommandAck) if ack.command == MavCmd.ROBOTREE_MOVE]
        return bool(acks) and acks[-1].result == MavResult.IN_PROGRESS

    def unfinished(self) -> set[int]:
        latest: dict[int, GoalState] = {}
        for message in (message for each in self.operators for message in each.all(GoalStatus)):
            if message.sequence:
                latest[message.key] = GoalState(message.state)
        return {key for key, state in latest.items() if not state.final}


TestFirmware = FirmwareMachine.TestCase
TestFirmware.settings = settings(max_examples=25, stateful_step_count=20, deadline=None)
