"""A conversation played against: links break, controllers restart, goals come and go, in any order."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robotree.protocol.messages import GoalState, ModeKind, Verb
from robotree.protocol.services.goal_client import GoalEnded, GoalSilent
from robotree.protocol.services.heartbeat import SILENCE
from robotree.proxy.desired_mode import RELEASE_TIMEOUT, ReleaseConfirmed, ReleaseRefused, ReleaseUnanswered
from robotree.proxy.motion import Request

DURATIONS = st.sampled_from([0.1, 1.0, 2.5, 4.0, 8.0])
"""[s]"""
GRIP = Request(Verb.GRIP, (0.02,))
RELEASE_ENDS = (ReleaseConfirmed, ReleaseRefused, ReleaseUnanswered)


def _talk() -> Any:
    """A conversation as in conftest.py, which a state machine cannot get as a fixture."""
    path = Path(__file__).with_name("conftest.py")
    spec = importlib.util.spec_from_file_location("proxy_conftest", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Talk()


class Conversation(RuleBasedStateMachine):
    """Rules are what may happen, invariants what must hold whatever happens."""

    def __init__(self) -> None:
        super().__init__()
        self.talk = _talk()
        self.linked = True
        self.settled_at = 0.0
        """[s] since when link and controller work and nothing new is wished for."""
        self.stop_wanted = False
        self.released_since: int | None = None
        """How many events there were when the release was asked for that no stop has followed; None: none."""
        self.epoch = 1
        self.keys: list[int] = []

    @rule(seconds=st.sampled_from([0.1, 0.3, 1.0, 2.0]))
    def wait(self, seconds: float) -> None:
        self.talk.wait(seconds)
        if self.talk.redials:
            self.link_breaks_for(0.1)

    @rule(seconds=DURATIONS)
    def link_breaks_for(self, seconds: float) -> None:
        self.talk.cut()
        self.linked = False
        self.talk.wait(seconds)
        self.online_means_linked_and_heard()
        self.talk.redials.clear()
        self.talk.connect()
        self.linked, self.settled_at = True, self.talk.now

    @rule(seconds=DURATIONS)
    def controller_is_silent_for(self, seconds: float) -> None:
        self.talk.controller.mute = True
        self.wait(seconds)
        self.online_means_linked_and_heard()
        self.talk.controller.mute = False
        self.settled_at = self.talk.now

    @rule(seconds=DURATIONS)
    def controller_restarts_within(self, seconds: float) -> None:
        self.talk.controller.begun.clear()
        self.talk.controller.restart()
        self.link_breaks_for(seconds)

    @precondition(lambda self: self.talk.session.online)
    @rule()
    def start(self) -> None:
        self.keys.append(len(self.keys) + 1)
        self.talk.perform(
            self.talk.session.start(self.keys[-1], GRIP, epoch=self.epoch, ttl=0.0, now=self.talk.now)
        )

    @precondition(lambda self: bool(self.keys))
    @rule(data=st.data())
    def cancel(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(self.keys))
        self.talk.perform(self.talk.session.cancel(key, epoch=self.epoch, now=self.talk.now))

    @precondition(lambda self: bool(self.talk.controller.begun))
    @rule(state=st.sampled_from([GoalState.SUCCEEDED, GoalState.FAILED]))
    def finish(self, state: GoalState) -> None:
        self.talk.controller.finish(state)

    @rule()
    def a_newer_lease(self) -> None:
        self.epoch += 1

    @rule()
    def somebody_else_stops(self) -> None:
        self.talk.controller.stop()

    @rule()
    def somebody_else_releases(self) -> None:
        self.talk.controller.release()
        self.settled_at = self.talk.now

    @precondition(lambda self: self.linked)
    @rule()
    def peace(self) -> None:
        """Wait until all requests are done or have failed; then the reported state is the true one."""
        self.wait(RELEASE_TIMEOUT + 1.0)
        assert bool(self.talk.session.held) == (self.talk.controller.mode == ModeKind.SAFE_STOP)
        assert self.talk.session.held or not self.stop_wanted
        if self.released_since is not None:
            told = [
                each for each in self.talk.events[self.released_since :] if isinstance(each, RELEASE_ENDS)
            ]
            assert len(told) == 1, "what became of a release is told, and once"

    @rule()
    def stop(self) -> None:
        self.talk.perform(self.talk.session.stop(self.talk.now))
        self.stop_wanted, self.settled_at = True, self.talk.now
        self.released_since = None
        self.talk.wait(0.2)

    @rule()
    def release(self) -> None:
        before = len(self.talk.events)
        self.talk.perform(self.talk.session.release(self.epoch, self.talk.now))
        self.stop_wanted, self.released_since = False, before

    @rule()
    def nobody_waits_for_the_release_any_more(self) -> None:
        self.talk.perform(self.talk.session.withdraw(self.talk.now))
        self.released_since = None

    @invariant()
    def a_goal_moves_at_most_once(self) -> None:
        begun = [begin.id.key for begin in self.talk.controller.begun]
        assert len(begun) == len(set(begun))

    @invariant()
    def the_end_of_a_goal_is_told_at_most_once(self) -> None:
        ends = [event.key for event in self.talk.events if isinstance(event, GoalEnded)]
        assert len(ends) == len(set(ends))

    @invariant()
    def silence_is_told_of_goals_only_that_were_asked_for(self) -> None:
        assert {event.key for event in self.talk.events if isinstance(event, GoalSilent)} <= set(self.keys)

    @invariant()
    def online_means_linked_and_heard(self) -> None:
        if self.talk.session.online:
            assert self.linked
            assert self.talk.now - self.talk.session.heard_at < SILENCE + 0.2
        else:
            assert self.talk.session.trouble

    @invariant()
    def turns_alternate(self) -> None:
        turns = self.talk.turns
        assert turns == [i % 2 == 0 for i in range(len(turns))]

    @invariant()
    def a_wanted_stop_is_in_force_as_soon_as_it_can_be(self) -> None:
        if self.stop_wanted and self.talk.now - self.settled_at > 1.0:
            assert self.talk.controller.mode == ModeKind.SAFE_STOP


TestConversation = Conversation.TestCase
TestConversation.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
