"""Those who command the companion die, freeze or lie while it carries a cup: it stands and holds the cup."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotree.protocol.messages import (
    Claim,
    ClaimStatus,
    ClaimWish,
    GoalState,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.sim.companion.flat import CUP_MASS
from robotree.sim.companion.guard import GRAVITY
from robotree.sim.companion.visitors import Wait
from robotree.sim.companion.world import CompanionWorld
from robotree.sim.firmware import SILENCE
from robotree.sim.kinds import LEFT_ARM
from robotree.sim.testing import Operator

from .test_handing_over import PEAK, with_a_cup

SOON = SILENCE + 3.0
"""[s] after which everything must stand: the link's silence, and the way to a stand."""


class Giving:
    """A cup is in the left hand, which moves, and the base drives."""

    def __init__(self) -> None:
        self.world, self.robot = with_a_cup(Wait(1000.0))
        self.left: Operator = self.robot.left.operator
        self.base: Operator = self.robot.base.operator
        self.all: tuple[Operator, ...] = (
            self.left,
            self.base,
            self.robot.right.operator,
            self.robot.head.operator,
        )
        self.move()

    def move(self) -> None:
        self.left.ask(Verb.REACH, 0.42, 0.22, 1.05, math.nan, math.pi / 2, 0.05)
        self.base.ask(Verb.MOVE, -1.5, 0.0, 0.15)
        self.base.wait(1.0)
        assert self.moving == {"arm", "base"}

    @property
    def moving(self) -> set[str]:
        body = self.world.body
        return {name for name, part in (("arm", body.limbs[0]), ("base", body.base)) if part.moving}

    def assert_held(self) -> None:
        """The cup is where it was, in a closed hand; nothing was hit."""
        assert cup_in_hand(self.world)
        state = self.world.body.limbs[0].state()
        assert state.grip_force > 5.0
        assert state.peak_force < PEAK
        assert state.wrench[2] == pytest.approx(-CUP_MASS * GRAVITY, abs=0.3), "the wrist feels its weight"


def cup_in_hand(world: CompanionWorld) -> bool:
    hand = world.cell.data.site_xpos[world.flat._tools[0]]
    return bool(np.linalg.norm(world.flat.cup(2) - hand) < 0.03)


@pytest.fixture
def giving() -> Giving:
    return Giving()


def test_a_hand_whose_proxy_hangs_stands_and_all_stand_whose_proxies_are_killed(giving: Giving) -> None:
    giving.left.silent = True  # as SIGSTOP does it
    giving.base.until(lambda: "arm" not in giving.moving, SOON)
    giving.assert_held()
    giving.left.silent = False
    giving.left.wait(1.5)
    answer = giving.left.do(Verb.REACH, 0.40, 0.22, 1.0, math.nan, math.pi / 2, 0.1)
    assert GoalState(answer.state) == GoalState.SUCCEEDED, "it is commanded again when it is back"
    giving.assert_held()
    giving.move()
    for each in giving.all:
        each.silent = True  # as `kill -9` does it
    giving.base.until(lambda: not giving.moving, SOON)
    giving.base.wait(0.5)
    before = giving.world.body.q
    giving.base.wait(2.0)
    assert abs(giving.world.body.q - before).max() < 0.02, "the arms stay where they are"
    giving.assert_held()


def test_a_second_client_cannot_open_the_hand_nor_anybody_during_a_stop(giving: Giving) -> None:
    giving.left.say(Claim(7, 2, 3000, 0, 1, LEFT_ARM, ClaimWish.KEEP, "robot-7"))
    giving.left.until(lambda: giving.left.latest(ClaimStatus).holder == 7, 3.0)
    thief = giving.left.another(component=66, system=9, target=LEFT_ARM)
    thief.say(Claim(8, 9, 3000, 0, 1, LEFT_ARM, ClaimWish.KEEP, "robot-8"))
    answer = thief.do(Verb.GRIP, 0.08, within=2.0, epoch=9)
    assert (GoalState(answer.state), Reason(answer.reason)) == (GoalState.REFUSED, Reason.NOT_IN_CONTROL)
    assert answer.text == "robot-7 holds this robot; end it, or take over."
    giving.left.wait(0.5)
    giving.assert_held()
    assert giving.moving
    giving.base.say(SetMode(1, 1, 0, ModeKind.SAFE_STOP))
    giving.base.until(lambda: not giving.moving, 2.0)
    giving.base.wait(0.5)
    assert not giving.moving
    giving.assert_held()
    answer = giving.left.do(Verb.GRIP, 0.08, epoch=2)
    assert (GoalState(answer.state), Reason(answer.reason)) == (GoalState.REFUSED, Reason.STOPPED)
    giving.base.wait(1.0)
    assert not giving.moving
    giving.assert_held()
