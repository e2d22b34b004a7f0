"""A session and the simulated controller: it notices a silent proxy, and others may stop it."""

from __future__ import annotations

from collections.abc import Hashable

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.messages import GoalState, ModeKind, Reason, SetMode, Verb
from robotree.protocol.services.goal_client import GoalEnded, GoalProgress
from robotree.protocol.services.peer import Send
from robotree.proxy.desired_mode import RELEASE_TIMEOUT
from robotree.proxy.motion import Request
from robotree.proxy.session import SUPERVISOR_SYSTEM, ControllerSession, SessionEffect
from robotree.sim.testing import RoverBench

STEP = 0.1
"""[s] between two ticks of a session."""
KEY = 7
REQUEST = Request(Verb.MOVE, (0.5, 0.0, 0.05))


class Talk:
    """A session and a controller in the world's time, and the link between them."""

    def __init__(self) -> None:
        self.controller = RoverBench().controller
        self.session = ControllerSession()
        self.told: list[SessionEffect] = []
        self._link: Hashable = None
        self._tick_at = 0.0

    @property
    def now(self) -> float:
        return self.controller.cell.time_ms / 1000

    def open(self, link: Hashable) -> None:
        self._link = link
        self.controller.greet(link)
        self._carry_out(self.session.opened(self.now))

    def start(self, request: Request, key: int = KEY) -> None:
        self._carry_out(self.session.start(key, request, epoch=1, ttl=0.0, now=self.now))

    def stop(self) -> None:
        self._carry_out(self.session.stop(self.now))

    def release(self) -> None:
        self._carry_out(self.session.release(1, self.now))

    def cut(self) -> None:
        self.controller.leave(self._link)
        self._link = None
        self._carry_out(self.session.closed("the cable was pulled"))

    def wait(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            if self.now >= self._tick_at:
                self._tick_at = self.now + STEP
                self._carry_out(self.session.tick(self.now))
            for outgoing in self.controller.advance():
                if self._link is not None and outgoing.via in {None, self._link}:
                    frame = Frame.of(outgoing.message, system=1, component=1)
                    self._carry_out(self.session.receive(frame, self.now))

    def _carry_out(self, effects: list[SessionEffect]) -> None:
        for effect in effects:
            if not isinstance(effect, Send):
                self.told.append(effect)
            elif self._link is not None:
                frame = Frame.of(effect.message, system=SUPERVISOR_SYSTEM, component=self.session.component)
                self.controller.post(frame, self._link)


@pytest.fixture
def talk() -> Talk:
    """A session whose robot moves slowly."""
    talk = Talk()
    talk.open("link 1")
    talk.wait(0.5)
    assert talk.session.online
    talk.start(REQUEST)
    talk.wait(0.6)  # a heartbeat has just been sent
    assert any(isinstance(each, GoalProgress) for each in talk.told)
    return talk


@pytest.mark.parametrize("pause", [0.1, 2.3])
def test_a_goal_ends_with_its_link_and_goes_on_over_a_new_one_only_if_it_is_asked_for_again(
    talk: Talk, pause: float
) -> None:
    talk.cut()
    talk.wait(0.01)
    assert talk.controller.firmware.mode == ModeKind.HOLD
    talk.wait(pause)
    talk.open("link 2")
    talk.told.clear()
    talk.wait(1.0)
    (end,) = [each for each in talk.told if isinstance(each, GoalEnded)]
    assert (end.state, end.reason) == (GoalState.CANCELLED, Reason.LINK_SILENT)
    assert talk.controller.firmware.mode == ModeKind.HOLD
    talk.start(REQUEST, key=KEY + 1)
    talk.wait(11.0)
    assert [each.state for each in talk.told if isinstance(each, GoalEnded)][1:] == [GoalState.SUCCEEDED]


def test_a_session_releases_no_stop_that_came_after_its_release(talk: Talk) -> None:
    talk.stop()
    talk.wait(1.0)
    talk.release()
    talk.controller.post(Frame.of(SetMode(0, 1, 1, ModeKind.SAFE_STOP), system=77), "another link")
    talk.wait(RELEASE_TIMEOUT + 1.0)
    assert talk.controller.firmware.mode == ModeKind.SAFE_STOP
    assert talk.session.held
    talk.release()
    talk.wait(1.0)
    assert talk.controller.firmware.mode == ModeKind.READY, "that one is newer than the stop"
