"""A cup is handed over, again and again, by the page's own code and real contacts; faults are told."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest

from robotree.sim.companion.flat import CUP_HEIGHT, TABLE_TOP
from robotree.sim.companion.tuning import FORCE_LIMIT
from robotree.sim.companion.visitors import Play, Receive, Wait
from robotree.sim.companion.world import CompanionWorld, build
from robotree.sim.testing import CompanionBench
from robotree.vr.errors import CommandFailed

from .virtual import companion

PEAK = 60.0
"""[N] that no contact of a hand may exceed: ISO/TS 15066, table A.2, allows 140 against a hand."""
BEFORE_SOFA = (0.95, -1.35)


def visit(play: Play, seed: int = 0) -> tuple[CompanionWorld, Any]:
    """Anna stands before the sofa, the companion before the table; a seed moves the cup, and her."""
    chance = random.Random(seed)
    world = build(plays=(play,), start=(0.6, 0.3, 0.6))
    anna = world.flat.visitors[0]
    spread = chance.uniform(-0.15, 0.15), chance.uniform(-0.12, 0.12)
    anna.put(BEFORE_SOFA[0] + spread[0], BEFORE_SOFA[1] + spread[1], chance.uniform(1.0, 2.6))
    anna.inside = True
    data, cup = world.cell.data, world.cell.model.joint("cup_2")
    at = int(cup.qposadr[0])
    data.qpos[at] += chance.uniform(-0.03, 0.03)
    data.qpos[at + 1] += chance.uniform(-0.12, 0.12)
    return world, companion(CompanionBench(world))


def hand_over(seed: int) -> tuple[CompanionWorld, float]:
    """Take the green cup and give it to Anna; returns the world and the largest force on a hand [N]."""
    world, robot = visit((Receive(),), seed)
    robot.look_at("table")
    robot.take("green cup")
    assert robot.holding() == "left"
    robot.go_to("sofa")
    robot.look_at("sofa")
    robot.look_towards(*BEFORE_SOFA, 1.0)
    robot.sleep(0.3)
    robot.give("anna")
    robot.sleep(1.0)
    return world, max(limb.state().peak_force for limb in world.body.limbs)


def assert_handed_over(seed: int) -> None:
    world, peak = hand_over(seed)
    anna = world.flat.visitors[0]
    assert anna.holding == 2, "she has closed her fingers about it"
    assert math.dist(world.flat.cup(2), anna.hand) < 0.5 * CUP_HEIGHT + 0.03, "it is in her hand"
    assert world.body.limbs[0].state().width > 0.07, "the robot's hand is open"
    assert peak < PEAK


@pytest.mark.parametrize("seed", [0])
def test_a_cup_is_handed_over(seed: int) -> None:
    assert_handed_over(seed)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(20))
def test_a_cup_is_handed_over_twenty_times_of_twenty(seed: int) -> None:
    assert_handed_over(seed)


def test_a_cup_that_a_visitor_drops_is_noticed() -> None:
    world, robot = visit((Receive(clumsy=True),))
    robot.look_at("table")
    robot.take("green cup")
    robot.go_to("sofa")
    robot.look_towards(*BEFORE_SOFA, 1.0)
    robot.sleep(0.3)
    with pytest.raises(CommandFailed, match="let it fall"):
        robot.give("anna")
    assert world.flat.cup(2)[2] < 0.2, "it lies on the floor"
    assert robot.holding() == "nothing"


@pytest.mark.soak
def test_who_holds_out_no_hand_gets_no_cup_and_it_goes_back_to_the_table() -> None:
    world, robot = visit((Wait(1000.0),))
    robot.look_at("table")
    robot.take("green cup")
    robot.go_to("sofa")
    robot.look_towards(*BEFORE_SOFA, 1.0)
    robot.sleep(0.3)
    with pytest.raises(CommandFailed, match="holds out no hand"):
        robot.give("anna")
    assert robot.holding() == "left"
    robot.put("table")
    assert robot.holding() == "nothing"
    assert world.flat.cup(2)[2] == pytest.approx(TABLE_TOP + CUP_HEIGHT / 2, abs=0.005), "it stands"


@pytest.mark.soak
def test_the_gestures_and_ways_of_the_library_end_where_they_began() -> None:
    world = build(plays=(), start=(0.0, 0.0, 0.0))
    robot = companion(CompanionBench(world))
    before = world.body.q
    robot.wave(2)
    robot.nod(1)
    robot.shake_head(1)
    robot.bow(0.4)
    robot.point_at("table")
    robot.rest()
    robot.sleep(0.5)
    assert abs(world.body.q - before).max() < 0.03
    robot.turn_to("door")
    robot.go_to("middle")
    assert robot.reach(0.45, 0.25, 1.0) == "left"
    assert max(limb.state().peak_force for limb in world.body.limbs) < FORCE_LIMIT
