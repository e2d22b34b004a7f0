"""The companion's promises: one body in four components, refusals before anything moves, a cup that is held.

In virtual time, over real frames.
"""

from __future__ import annotations

import itertools
import math
import random
import time

import numpy as np
import pytest

from robotree.protocol.messages import (
    GoalState,
    GoalStatus,
    Heartbeat,
    ModeKind,
    Reason,
    SetMode,
    Speech,
    Tags,
    Verb,
)
from robotree.sim.companion import figure as figures
from robotree.sim.companion.figure import ARMS, JOINT_NAMES, SIDES, Figure, Pose, tool
from robotree.sim.companion.flat import PREFIX, TABLE_TOP
from robotree.sim.companion.guard import BODY, LIMB, NEIGHBOURS
from robotree.sim.companion.planner import REST, SEEDS
from robotree.sim.companion.tuning import FORCE_LIMIT, HAND_SPEED
from robotree.sim.companion.visitors import Say, Walk
from robotree.sim.companion.world import Flat, build
from robotree.sim.firmware import COMPONENT
from robotree.sim.kinds import HEAD, LEFT_ARM, RIGHT_ARM
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector
from robotree.sim.testing import NAN, CompanionBench, Operator

AT_TABLE = (1.03, 0.7, 0.0)
"""Where the second cup stands 0.45 m ahead and 0.20 m to the left."""
LEVEL = math.pi / 2
INTO_THE_BODY = (0.6, -0.7, -1.5, 1.9, 0.0, 0.0)
"""[rad] of a left arm."""


@pytest.fixture
def free() -> CompanionBench:
    """In the middle of the floor, with nothing in reach."""
    return CompanionBench()


@pytest.fixture
def table() -> CompanionBench:
    """Before the table."""
    return CompanionBench(start=AT_TABLE)


def led(flat: Flat, component: int) -> Vector:
    """Where a component is led."""
    body = flat.body
    if component == HEAD:
        return np.array(body.head.led)
    if component == COMPONENT:
        return np.array((*body.base.look().led, body.base.led_lean))
    return np.array(body.limbs[component == RIGHT_ARM].led)


def refused(operator: Operator, reason: Reason, verb: Verb, *args: float) -> str:
    """Ask for something that must be refused for this reason; returns the sentence."""
    flat = operator.controller.cell.device
    assert isinstance(flat, Flat)
    before = led(flat, operator.target)
    answer = operator.do(verb, *args)
    operator.wait(0.2)
    assert (GoalState(answer.state), Reason(answer.reason)) == (GoalState.REFUSED, reason), answer.text
    np.testing.assert_array_equal(led(flat, operator.target), before, "nothing is led anywhere")
    assert answer.text
    return answer.text


# -- one body, two engines


def test_both_engines_compute_the_same_hands_and_weight() -> None:
    figure, world = Figure(), build(plays=())
    model, data = world.cell.model, world.cell.data
    q = np.random.default_rng(7).uniform(figure.lower, figure.upper)
    for name, value in zip(JOINT_NAMES, q, strict=True):
        data.qpos[model.joint(PREFIX + name).qposadr[0]] = value
    world.ports.root[:] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    world.cell.advance(0)
    from robotree.sim.physics.engine import mujoco

    mujoco.mj_forward(model, data)
    for side, pose in enumerate(figure.poses(q)):
        site = model.site(f"{PREFIX}{SIDES[side]}_tcp").id
        np.testing.assert_allclose(pose.position, data.site_xpos[site], atol=1e-9)
        np.testing.assert_allclose(pose.rotation.ravel(), data.site_xmat[site], atol=1e-9)
    centre = data.subtree_com[model.body(PREFIX + "base").id]
    np.testing.assert_allclose(figure.balance(q).centre, centre, atol=1e-3)


# -- four components of one controller


def test_each_component_beats_and_obeys_only_what_is_for_it(free: CompanionBench) -> None:
    free.base.wait(1.2)
    assert all(each.all(Heartbeat) for each in (free.base, free.left, free.right, free.head))
    refused(free.head, Reason.UNKNOWN_VERB, Verb.DRIVE, 1.0, 0.0, 0.0)
    refused(free.base, Reason.UNKNOWN_VERB, Verb.GRIP, 0.0)
    free.right.succeed(Verb.GRIP, 0.0)
    left, right = free.world.body.limbs
    assert (left.state().width, right.state().width) == pytest.approx((0.06, 0.0), abs=2e-3)


def test_a_stop_of_one_component_stops_it_alone_and_one_for_all_stops_all(free: CompanionBench) -> None:
    free.left.say(SetMode(1, 1, LEFT_ARM, ModeKind.SAFE_STOP))
    free.left.wait(0.1)
    assert free.left.mode()[0] == ModeKind.SAFE_STOP
    assert free.right.mode()[0] == ModeKind.READY
    refused(free.left, Reason.STOPPED, Verb.GRIP, 0.0)
    free.right.succeed(Verb.GRIP, 0.02)
    free.base.say(SetMode(1, 1, 0, ModeKind.SAFE_STOP))
    free.base.wait(0.1)
    assert {each.mode()[0] for each in (free.base, free.left, free.right, free.head)} == {ModeKind.SAFE_STOP}


def test_what_is_for_all_components_is_answered_once_by_the_first(free: CompanionBench) -> None:
    key = free.base.ask(Verb.LOOK, 0.2, 0.0)
    free.base.end_of(key)
    everyone = [each for each in (free.base, free.left, free.right, free.head) if each.all(GoalStatus)]
    assert everyone == [free.base]


def test_the_components_have_lives_and_claims_of_their_own(free: CompanionBench) -> None:
    components = [program.component for program in free.controller.programs]
    assert components == [1, LEFT_ARM, RIGHT_ARM, HEAD]
    free.left.succeed(Verb.GRIP, 0.02)
    late = free.right.do(Verb.GRIP, 0.02, epoch=0)
    assert GoalState(late.state) == GoalState.SUCCEEDED, "the left arm's epoch is not the right arm's"


# -- refusals, before anything moves


@pytest.mark.parametrize(
    ("reason", "words", "verb", "args"),
    [
        (Reason.BAD_ARGUMENT, "j1 is 4.00 rad; it goes from -0.90 to 2.90", Verb.POSTURE, (4.0, *REST[1:])),
        (Reason.OUT_OF_REACH, "m from the shoulder", Verb.REACH, (1.5, 0.2, 1.0, NAN, NAN)),
        (Reason.SELF_COLLISION, "would come nearer than 15 mm", Verb.POSTURE, INTO_THE_BODY),
    ],
)
def test_what_an_arm_cannot_do_is_refused_with_the_reason(
    free: CompanionBench, reason: Reason, words: str, verb: Verb, args: tuple[float, ...]
) -> None:
    assert words in refused(free.left, reason, verb, *args)


def test_a_reach_through_the_table_is_refused(table: CompanionBench) -> None:
    said = refused(table.left, Reason.PATH_BLOCKED, Verb.REACH, 0.50, 0.25, TABLE_TOP - 0.02, NAN, LEVEL)
    assert "table" in said


@pytest.mark.parametrize(("x", "y", "name"), [(1.75, 0.9, "table"), (9.0, 0.0, "wall"), (2.6, -1.2, "shelf")])
def test_a_drive_into_something_is_refused(free: CompanionBench, x: float, y: float, name: str) -> None:
    assert name in refused(free.base, Reason.PATH_BLOCKED, Verb.DRIVE, x, y, 0.0)


def test_one_hand_does_not_go_where_the_other_arm_is_going(free: CompanionBench) -> None:
    key = free.right.ask(Verb.REACH, 0.45, 0.05, 1.0, NAN, LEVEL, 0.25)
    free.right.wait(0.3)
    refused(free.left, Reason.SELF_COLLISION, Verb.REACH, 0.45, 0.03, 1.0, NAN, LEVEL)
    assert GoalState(free.right.end_of(key).state) == GoalState.SUCCEEDED


def test_what_would_tip_it_over_is_refused_and_what_the_guard_calls_balanced_does_not(
    free: CompanionBench,
) -> None:
    """The base stands freely: it leans as far as allowed, both arms stretched, drives off and brakes."""
    for arm in (free.left, free.right):
        arm.succeed(Verb.POSTURE, 1.45, 0.0, 0.0, 0.15, 0.0, 0.0, 0.5)
    lean = 0.0
    while GoalState(free.base.do(Verb.LEAN, lean + 0.05).state) == GoalState.SUCCEEDED:
        lean += 0.05
    assert "tip over" in refused(free.base, Reason.TIP_OVER, Verb.LEAN, lean + 0.05)
    free.base.succeed(Verb.MOVE, -0.5, 0.0, 0.8)
    w, x, y, _ = free.world.ports.root[3:7].tolist()
    assert math.hypot(x, y) / w < 0.01, "all wheels stand on the floor"


def visited(x: float, y: float) -> CompanionBench:
    """Anna stands at a place."""
    world = build(plays=(), start=(0.0, 0.0, 0.0))
    world.flat.visitors[0].put(x, y)
    return CompanionBench(world)


def test_a_drive_that_ends_beside_a_person_is_refused() -> None:
    bench = visited(-1.0, 0.0)
    assert refused(bench.base, Reason.TOO_NEAR, Verb.MOVE, -0.7, 0.0) == (
        "anna would be nearer than 0.45 m; wait or go elsewhere"
    )
    bench.base.succeed(Verb.MOVE, -0.4, 0.0)


def test_a_hand_that_would_touch_a_person_is_refused() -> None:
    bench = visited(0.6, 0.2)
    said = refused(bench.left, Reason.TOO_NEAR, Verb.REACH, 0.45, 0.2, 1.1, NAN, LEVEL)
    assert "anna" in said


def test_a_fast_hand_beside_a_person_is_refused_and_a_slow_one_goes() -> None:
    bench = visited(0.85, 0.3)
    assert "move the hand at 0.25 m/s" in refused(
        bench.left, Reason.TOO_NEAR, Verb.REACH, 0.35, 0.3, 1.0, NAN, LEVEL, 0.6
    )
    bench.left.succeed(Verb.REACH, 0.35, 0.3, 1.0, NAN, LEVEL, HAND_SPEED)


def test_the_base_slows_down_for_a_person_who_walks_into_its_way_and_goes_on_afterwards() -> None:
    world = build(plays=((Walk((1.0, -0.1)), Walk((1.0, -1.8))),), start=(-1.0, -0.1, 0.0))
    world.flat.visitors[0].put(1.3, 1.5)
    bench = CompanionBench(world)
    key = bench.base.ask(Verb.DRIVE, 2.0, -0.1, 0.0, 0.8)
    nearest = math.inf
    while not bench.base.knows(key) or not GoalState(bench.base.status_of(key).state).final:
        bench.base.step()
        nearest = min(nearest, world.body.nearest)
    assert GoalState(bench.base.status_of(key).state) == GoalState.SUCCEEDED
    assert nearest > 0.36, "base and person have not touched"


# -- what it does


def test_a_hand_presses_no_harder_than_its_limit(free: CompanionBench) -> None:
    """Somebody holds the hand while it moves: it waits on its leash, and says what holds it."""
    free.left.succeed(Verb.REACH, 0.35, 0.3, 1.0, NAN, LEVEL, 0.25)
    data, model = free.world.cell.data, free.world.cell.model
    hand = model.body(PREFIX + "left_hand").id
    here = np.array(data.xpos[hand])
    key = free.left.ask(Verb.REACH, 0.45, 0.3, 1.2, NAN, LEVEL, 0.25)
    strongest, before = 0.0, np.zeros(3)
    while not (free.left.knows(key) and GoalState(free.left.status_of(key).state).final):
        away = here - data.xpos[hand]
        data.xfrc_applied[hand, :3] = 2000.0 * away + 40.0 * (away - before) / 0.01
        before = away
        free.left.step()
        strongest = max(strongest, float(np.linalg.norm(free.world.body.limbs[0].state().wrench[:3])))
    answer = free.left.status_of(key)
    assert (GoalState(answer.state), Reason(answer.reason)) == (GoalState.FAILED, Reason.BLOCKED)
    assert "holds the tool" in answer.text
    steady = float(np.linalg.norm(free.world.body.limbs[0].state().wrench[:3]))
    assert steady < FORCE_LIMIT + 4.0, "of the spring, and of the weak one of the posture"
    assert strongest < FORCE_LIMIT + 10.0, "with what braking it takes"


def test_the_head_sees_tags_before_it_and_not_behind(table: CompanionBench) -> None:
    table.head.succeed(Verb.LOOK, 0.0, 0.5, 2.0)
    table.head.wait(0.3)
    seen = table.head.latest(Tags)
    tags = {seen.tag[i]: (seen.x[i], seen.y[i], seen.z[i]) for i in range(seen.count)}
    assert {1, 2} <= tags.keys()
    assert tags[2] == pytest.approx(tuple(table.world.flat.cup(2)), abs=1e-3)
    away = CompanionBench(start=(1.03, 0.7, math.pi))
    away.head.wait(0.5)
    assert away.head.latest(Tags).count == 0


def test_it_speaks_only_what_was_sent_and_hears_visitors() -> None:
    world = build(plays=((Say("Good day."),),), start=(0.0, 0.0, 0.0))
    bench = CompanionBench(world)
    refused(bench.head, Reason.BAD_ARGUMENT, Verb.SAY, 7.0)
    bench.head.say(Speech(0, 7, 1, HEAD, 0, "Welcome, Zoë"))
    bench.head.succeed(Verb.SAY, 7.0)
    assert world.flat.spoken == ["Welcome, Zoë"]
    bench.head.wait(1.0)
    heard = bench.head.latest(Speech)
    assert (heard.number, heard.speaker, heard.text) == (1, 11, "Good day.")


def test_an_empty_battery_refuses_what_moves_and_still_holds(free: CompanionBench) -> None:
    free.world.flat.battery.charge = 0.01
    free.base.wait(0.1)
    assert "battery" in refused(free.base, Reason.FAULT, Verb.DRIVE, 0.5, 0.0, 0.0)
    refused(free.left, Reason.FAULT, Verb.POSTURE, *REST)
    free.left.succeed(Verb.HOLD)


ALLOWED = {Reason.OUT_OF_REACH, Reason.SELF_COLLISION, Reason.PATH_BLOCKED, Reason.TIP_OVER}
"""Why a random reach may be refused."""


def pairs(bench: CompanionBench) -> list[tuple[int, int]]:
    """Geoms of the body that must not touch."""
    model = bench.world.cell.model
    limbs = [(side, limb) for side in SIDES for limb in LIMB]
    names = [
        (f"{side}_{limb}", body)
        for (side, limb), body in itertools.product(limbs, BODY)
        if (limb, body) not in NEIGHBOURS
    ]
    names += [(f"left_{mine}", f"right_{other}") for mine, other in itertools.product(LIMB, LIMB)]
    return [(model.geom(PREFIX + a).id, model.geom(PREFIX + b).id) for a, b in names]


def smallest_gap(bench: CompanionBench, among: list[tuple[int, int]]) -> float:
    """[m] between any two of them; 5 cm when all are further apart."""
    cell = bench.world.cell
    return min(mujoco.mj_geomDistance(cell.model, cell.data, a, b, 0.05, None) for a, b in among)


def ask(arm: Operator, side: int, chance: random.Random) -> int:
    """Ask for a random reach, often before the body, where the arms meet."""
    x, z = chance.uniform(-0.1, 0.65), chance.uniform(0.35, 1.45)
    y = chance.uniform(-0.25, 0.65) * (1 if side == 0 else -1)
    return arm.ask(Verb.REACH, x, y, z, NAN, NAN, chance.uniform(0.25, 0.8))


def reach_at_random(count: int, seed: int) -> tuple[int, float, float]:
    """Let both arms reach `count` times; returns how many did, the smallest gap [m], the peak [N]."""
    chance, bench = random.Random(seed), CompanionBench()
    among, arms = pairs(bench), (bench.left, bench.right)
    keys: list[int | None] = [None, None]
    reached = asked = 0
    gap = 1.0
    while asked < count or any(key is not None for key in keys):
        for side, arm in enumerate(arms):
            key = keys[side]
            if key is None and asked < count:
                keys[side] = ask(arm, side, chance)
                asked += 1
            elif key is not None and arm.knows(key) and GoalState(arm.status_of(key).state).final:
                status = arm.status_of(key)
                reached += status.state == GoalState.SUCCEEDED
                if status.state == GoalState.REFUSED:
                    assert Reason(status.reason) in ALLOWED, status.text
                    assert status.text
                keys[side] = None
        bench.base.step()
        bench.base.step()
        gap = min(gap, smallest_gap(bench, among))
    peak = max(limb.state().peak_force for limb in bench.world.body.limbs)
    return reached, gap, peak


def test_random_reaches_never_bring_the_body_to_touch_itself() -> None:
    reached, gap, peak = reach_at_random(12, seed=3)
    assert reached >= 3
    assert gap > 0.0
    assert peak < FORCE_LIMIT


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_five_hundred_random_reaches_never_bring_the_body_to_touch_itself() -> None:
    reached, gap, peak = reach_at_random(500, seed=1)
    assert reached > 100
    assert gap > 0.0
    assert peak < FORCE_LIMIT


@pytest.fixture(scope="module")
def figure() -> Figure:
    return Figure()


@pytest.mark.speed
def test_a_search_that_comes_no_nearer_is_given_up(figure: Figure) -> None:
    q = np.zeros(15)
    beyond = Pose(np.array((2.0, 0.3, 1.0)), tool(0.0, math.pi / 2))
    began = time.thread_time()
    found = figure.solve(0, beyond, q, np.array(REST), iterations=1_000_000)
    assert not found.reached
    assert time.thread_time() - began < 0.5


def test_giving_up_early_loses_no_posture_that_a_long_search_finds(
    figure: Figure, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = np.random.default_rng(3)
    lower, upper = figure.lower[ARMS[0]], figure.upper[ARMS[0]]
    goals: list[Pose] = []
    for _ in range(60):
        q = np.zeros(15)
        q[ARMS[0]] = chance.uniform(lower, upper)
        pose = figure.pose(0, q)
        moved = chance.choice((0.0, 0.3), p=(0.7, 0.3))  # some a little out of reach
        goals.append(Pose(pose.position + np.array((moved, 0.0, 0.0)), pose.rotation))

    def reached() -> list[bool]:
        seeds = [np.array(seed) for seed in SEEDS]
        return [any(figure.solve(0, goal, q, seed, 40).reached for seed in seeds) for goal in goals]

    q = np.zeros(15)
    soon = reached()
    monkeypatch.setattr(figures, "NEARER", math.inf)
    assert soon == reached()
    assert 20 < sum(soon) < 58, "both kinds were among them"
