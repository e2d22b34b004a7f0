"""A hundred idle robots cost little on a line, and what was lost is sent again."""

from __future__ import annotations

import random

import msgspec

from robotree.vr.base.requests import State, encode
from robotree.vr.sites.frames import SiteState, StillSo, encode_frame
from robotree.vr.sites.sealing import OVERHEAD
from robotree.vr.sites.summary import Mirrors, Summaries, is_state

SLOW = 8_000.0
"""[bytes/s] 64 kbit/s."""
BEATS = 2 * 2 * 75
"""[bytes/s] of beats and their receipts."""


def key(number: int) -> str:
    return f"robot/arm-{number}/{number:016x}/state"


def state(x: float = 0.0, **fields: object) -> bytes:
    readings = {name: x + place for place, name in enumerate(("x", "y", "z", "fx", "fy", "fz", "width"))}
    return encode(msgspec.structs.replace(State(readings=readings, epoch=1_800_000_000), **fields))


def sent_in(seconds: int, noise: float, rate: float = SLOW) -> tuple[int, dict[str, float]]:
    """Let 100 idle robots speak once a second; return bytes per second, and when each was told last."""
    chance, summaries = random.Random(1), Summaries(0.0)
    sent, last = 0, dict[str, float]()
    for tenth in range(seconds * 10):
        now = tenth / 10
        frames: list[SiteState | StillSo] = []
        if tenth % 10 == 0:
            for number in range(100):
                taken = summaries.take(key(number), state(noise * chance.random()), now)
                frames += [taken] if taken else []
        frames += summaries.due(now, rate)
        for frame in frames:
            if isinstance(frame, SiteState):
                last[frame.key] = now
            if now >= 2:  # before that, each is told once
                sent += len(encode_frame(frame)) + OVERHEAD
    return round(sent / (seconds - 2)), last


def test_a_hundred_idle_robots_cost_less_than_two_kilobytes_a_second() -> None:
    quiet, _ = sent_in(20, noise=0.0)
    assert quiet + BEATS < 1_000
    noisy, last = sent_in(40, noise=1e-4)
    assert noisy + BEATS < 2_000
    assert len(last) == 100
    assert min(last.values()) > 40 - 25, "no reading waits for ever"


def test_few_robots_and_quick_lines_have_all_their_readings() -> None:
    summaries = Summaries(0.0)
    summaries.take(key(1), state(), 0.0)
    told = 0
    for tenth in range(1, 101):
        assert summaries.take(key(1), state(tenth), tenth / 10) is None
        told += sum(isinstance(frame, SiteState) for frame in summaries.due(tenth / 10, 1e6))
    assert told == 100


def test_what_changes_leaves_at_once_and_the_readings_of_a_busy_robot_too() -> None:
    summaries = Summaries(0.0)
    assert summaries.take(key(1), state(), 0.0) == SiteState(1, key(1), state())
    assert summaries.take(key(1), state(), 0.1) is None
    stopped = state(stopped=True)
    assert summaries.take(key(1), stopped, 0.2) == SiteState(1, key(1), stopped)
    for x in (1.0, 2.0):
        moving = state(x, busy="move")
        assert summaries.take(key(1), moving, 0.3) == SiteState(1, key(1), moving)
    assert summaries.take(key(2), b"no state", 0.3) == SiteState(2, key(2), b"no state")
    assert summaries.take(key(2), b"another", 0.3) == SiteState(2, key(2), b"another")


def test_the_other_site_hears_again_what_is_still_so_and_asks_for_what_was_lost() -> None:
    summaries, mirrors = Summaries(0.0), Mirrors()
    for number in (1, 2):
        first = summaries.take(key(number), state(), 0.0)
        assert first
        if number == 1:
            mirrors.take(first)  # the other one is lost
    for number in (1, 2):
        summaries.take(key(number), state(), 1.0)
    (still,) = summaries.due(1.0, SLOW)
    assert isinstance(still, StillSo)
    same, lost = mirrors.still(still)
    assert same == [(key(1), state())]
    (again,) = summaries.again(lost)
    assert again == SiteState(2, key(2), state())
    mirrors.take(again)
    assert [one for one, _ in mirrors.still(still)[0]] == [key(1), key(2)]
    assert summaries.due(2.0, SLOW) == [], "who says nothing any more is not still so"


def test_a_state_that_is_on_its_way_is_not_asked_for() -> None:
    summaries = Summaries(0.0)
    summaries.take(key(1), state(), 0.0)
    summaries.take(key(1), state(stopped=True), 0.9)
    assert summaries.due(1.0, SLOW) == []


def test_who_has_gone_is_forgotten_on_both_sides() -> None:
    summaries, mirrors = Summaries(0.0), Mirrors()
    first = summaries.take(key(1), state(), 0.0)
    assert first
    mirrors.take(first)
    agent = key(1).removesuffix("/state")
    summaries.take(key(1), state(), 0.5)
    summaries.forget(agent)
    mirrors.forget(agent)
    assert summaries.due(1.0, SLOW) == []
    assert summaries.again([1]) == []
    assert summaries.take(key(1), state(), 2.0) == SiteState(2, key(1), state())
    assert is_state(key(1))
    assert not is_state("lookup/l1/2/state")
