"""The firmware against an opponent: whatever is asked in whatever order, its promises hold."""

from __future__ import annotations

import itertools
from enum import Enum, auto

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robotree.protocol.messages import (
    CommandAck,
    CommandCancel,
    GoalState,
    GoalStatus,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    Reason,
    Setpoint,
    SetpointKind,
    Verb,
)
from robotree.sim.testing import NAN, Operator, RoverBench


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
