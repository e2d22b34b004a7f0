"""Where robots are placed: the estimator, the machine of one robot, who goes first; and rates of calls."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robotree.vr.base.description import HostLoad, Placement
from robotree.vr.core.placement import (
    CALM,
    GAIN,
    LOOKS,
    REFUSED_FOR,
    SHARE,
    STAY,
    Contact,
    HostSeen,
    PlaceAdvice,
    PlacedRobot,
    PlaceWatch,
    Placing,
    seated,
    spent,
)
from robotree.vr.core.traffic import FADES, BondTraffic

ARM, PARENT = "robot/arm/1", "robot/boss/1"
LONG_AGO = -math.inf


def host(
    name: str, ways: Mapping[str, float], *, cpu: float = 0.0, room: int | None = None, running: int = 0
) -> HostSeen:
    return HostSeen(name, f"host/{name}/1", ways, HostLoad(cpu=cpu, room=room, running=running))


def robot(mode: Placement = "auto", calls: float = 3.0, **other: object) -> PlacedRobot:
    return PlacedRobot("tour", mode, [Contact(ARM, "arm", calls)], **other)  # type: ignore[arg-type]


FAR = host("desk", {ARM: 0.3, "host/plant/1": 0.3})
NEAR = host("plant", {ARM: 0.001})


def looks(watch: PlaceWatch, robot: PlacedRobot, times: int = LOOKS, here: HostSeen = FAR) -> PlaceAdvice:
    return [watch.look(robot, here, [NEAR], float(second)) for second in range(times)][-1]


def test_a_robot_moves_to_its_arm_and_says_why_in_one_sentence() -> None:
    advice = looks(PlaceWatch(LONG_AGO), robot())
    assert (advice.moves, advice.target) == (True, "plant")
    assert advice.why == (
        "plant is nearer than desk: its 3.0 calls a second with arm take 1.0 ms instead of 300 ms, so of each"
        " second 0.90 s go by on the way here, 0.00 s there"
    )


@pytest.mark.parametrize(
    ("one", "others", "words"),
    [
        (robot("manual"), [NEAR], "only people move it"),
        (robot(pinned=True), [NEAR], "its author has pinned it"),
        (robot(calls=0.01), [NEAR], "too little to do"),
        (robot(calls=0.1), [NEAR], "no host is clearly better"),
        (robot(unfit="self.file is an open file"), [NEAR], "it cannot travel: self.file is an open file"),
        (robot(), [host("plant", NEAR.ways, room=0)], "but plant is full"),
        (robot(), [host("other", {})], "no other host is known to reach"),
        (robot(), [], "no other host is known to reach"),
        (robot(strangers=3.0), [NEAR], "no host is clearly better"),
        (robot(), [host("plant", {ARM: 0.29})], "no host is clearly better"),
    ],
)
def test_a_robot_stays_and_says_why(one: PlacedRobot, others: list[HostSeen], words: str) -> None:
    watch = PlaceWatch(LONG_AGO)
    advice = [watch.look(one, FAR, others, float(second)) for second in range(9)]
    assert not any(each.moves for each in advice)
    assert words in advice[-1].why


def test_who_is_only_advised_does_not_move_and_hears_where() -> None:
    advice = looks(PlaceWatch(LONG_AGO), robot("advise"), 20)
    assert (advice.moves, advice.target) == (False, "plant")


def test_it_stays_for_a_while_where_it_has_come_to_and_longer_each_time() -> None:
    watch = PlaceWatch(0.0)
    moves = [second for second in range(30) if watch.look(robot(), FAR, [NEAR], float(second)).moves]
    assert moves[0] == STAY
    placing, unix, stays = Placing(), 1e9, list[float]()
    for _ in range(9):
        stays.append(placing.stay(unix))
        placing = placing.moving("it is better", unix)
        unix += 1.0
    assert stays[:4] == [STAY, STAY, 2 * STAY, 4 * STAY]
    assert stays == sorted(stays)
    assert stays[-1] <= 64 * STAY
    assert placing.stay(unix + CALM + 1.0) == STAY


def test_a_host_that_has_refused_it_is_left_alone_for_a_while() -> None:
    watch = PlaceWatch(LONG_AGO)
    assert looks(watch, robot()).moves
    watch.refused("plant", 2.0)
    moves = [second for second in range(3, 60) if watch.look(robot(), FAR, [NEAR], float(second)).moves]
    assert moves[0] == 2.0 + REFUSED_FOR
    watch.refused("plant", 60.0)
    late = 60.0 + 2 * REFUSED_FOR  # the moves of others have held up the looks
    assert [watch.look(robot(), FAR, [NEAR], late + second).moves for second in range(2)] == [False, True]


def test_a_host_that_is_better_only_now_and_then_moves_nobody() -> None:
    watch, same = PlaceWatch(LONG_AGO), host("plant", {ARM: 0.3})
    advice = [watch.look(robot(), FAR, [NEAR if second % 2 else same], float(second)) for second in range(20)]
    assert not any(one.moves for one in advice)


def test_of_two_hosts_as_near_the_one_with_less_to_do_is_taken() -> None:
    busy, idle = host("busy", {ARM: 0.001}, cpu=0.9), host("idle", {ARM: 0.001}, cpu=0.1)
    assert PlaceWatch(LONG_AGO).look(robot(), FAR, [busy, idle], 0.0).target == "idle"
    here = host("desk", {ARM: 0.001}, cpu=0.95)
    advice = PlaceWatch(LONG_AGO).look(robot(calls=50.0), here, [idle], 0.0)
    assert advice.target == "idle"
    assert "idle has less to do than desk" in advice.why


def test_urgent_robots_go_first_then_those_that_gain_most_and_nobody_into_a_full_host() -> None:
    def wish(saved: float, *, urgent: bool = False, moves: bool = True) -> PlaceAdvice:
        return PlaceAdvice("", "plant", moves, saved, urgent)

    advice = {
        "idle": wish(0.9),
        "busy": wish(0.2, urgent=True),
        "some": wish(0.5),
        "none": wish(1, moves=False),
    }
    assert seated(advice, {"plant": None}) == (["busy", "idle", "some"], [])
    assert seated(advice, {"plant": 1}) == (["busy"], ["idle", "some"])
    assert seated(advice, {"plant": 0}) == ([], ["busy", "idle", "some"])


@given(
    ways=st.lists(st.floats(0.0, 3000.0), min_size=3, max_size=3),
    calls=st.floats(0.0, 1000.0),
    strangers=st.floats(0.0, 100.0),
    cpu=st.lists(st.floats(0.0, 3.0), min_size=3, max_size=3),
)
@settings(deadline=None)
def test_who_moves_gains_and_does_not_want_back(
    ways: list[float], calls: float, strangers: float, cpu: list[float]
) -> None:
    hosts = [
        host(name, {ARM: way, **{f"host/{other}/1": 0.01 for other in "abc"}}, cpu=load)
        for name, way, load in zip("abc", ways, cpu, strict=True)
    ]
    here, *others = hosts
    one, watch = robot(calls=calls, strangers=strangers), PlaceWatch(LONG_AGO)
    advice = [watch.look(one, here, others, float(second)) for second in range(LOOKS)][-1]
    if not advice.moves:
        return
    there = next(each for each in hosts if each.name == advice.target)
    before, after = spent(one, here, here), spent(one, there, here)
    assert before is not None
    assert after is not None
    assert before - after >= max(GAIN, SHARE * before) - 1e-9
    back = PlaceWatch(LONG_AGO).look(one, there, [here], 0.0)
    assert back.target != here.name


class Walks(RuleBasedStateMachine):
    """A robot between hosts whose ways change as they like: how often does it move?"""

    def __init__(self) -> None:
        super().__init__()
        self.now, self.arrived = 0.0, LONG_AGO
        self.placing, self.at = Placing(), "a"
        self.watch, self.moved = PlaceWatch(LONG_AGO), list[float]()
        self.ways = {"a": 0.1, "b": 0.1}

    @rule(name=st.sampled_from("ab"), way=st.floats(0.0, 2.0))
    def way_changes(self, name: str, way: float) -> None:
        self.ways[name] = way

    @rule(times=st.integers(1, 40))
    def looks(self, times: int) -> None:
        for _ in range(times):
            self.now += 1.0
            seen = {name: host(name, {ARM: way}) for name, way in self.ways.items()}
            one = robot(stay=self.placing.stay(1e9 + self.now))
            there = "b" if self.at == "a" else "a"
            advice = self.watch.look(one, seen[self.at], [seen[there]], self.now)
            assert advice.why
            if advice.moves:
                assert self.ways[self.at] > self.ways[there], "it moves for a gain only"
                self.placing = self.placing.moving(advice.why, 1e9 + self.now)
                self.at, self.watch = there, PlaceWatch(self.now)
                self.moved.append(self.now)

    @invariant()
    def it_does_not_run_to_and_fro(self) -> None:
        pairs = zip(self.moved, self.moved[1:], strict=False)
        assert all(later - earlier >= STAY for earlier, later in pairs)
        minute = [moment for moment in self.moved if moment > self.now - 60.0]
        assert len(minute) <= 5


TestWalks = Walks.TestCase
TestWalks.settings = settings(max_examples=40, deadline=None)


def test_the_rate_of_calls_is_known_soon_and_forgotten_soon() -> None:
    traffic = BondTraffic(lambda: 0.0, threading.Lock())
    for call in range(10):
        traffic.note("child", call * 0.3, calls=1, size=100)
    calls, size = traffic.flows(3.0)["child"]
    assert calls == pytest.approx(3.3, rel=0.2)
    assert size == pytest.approx(330, rel=0.2)
    assert traffic.flows(3.0 + 3 * FADES)["child"].calls < 0.2
    assert traffic.flows(1000.0)["child"].calls == 0.0
    for call in range(10):
        traffic.note("child", 1000.0 + call * 0.3, calls=1)
    assert traffic.flows(1003.0)["child"].calls == pytest.approx(3.3, rel=0.2)


def test_of_many_peers_the_latest_are_counted() -> None:
    traffic = BondTraffic(lambda: 0.0, threading.Lock())
    for number in range(1000):
        traffic.note(f"peer-{number}", float(number), calls=1)
    flows = traffic.flows(1000.0)
    assert len(flows) < 300
    assert "peer-999" in flows
