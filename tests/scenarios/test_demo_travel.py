"""The demo of the right place: real sites, a slow line, and robots that move over it, also by themselves.

How much faster they are near the arm depends on what else this machine does, and is no part of this test: see
docs/performance.md.
"""

from __future__ import annotations

import asyncio
import json

import pytest

from robotree.tui import demo_sites, demo_travel
from robotree.tui.demo_crash import Goal
from robotree.tui.demo_travel import counted, plot

LINE = 60
"""[ms] one way."""


def test_what_the_controller_has_begun_twice_or_never_is_counted() -> None:
    goals = [Goal(1.0, key) for key in ("a/1", "a/2", "a/3")]
    assert counted(goals, 3) == (0, 0)
    assert counted(goals, 4) == (0, 1)
    assert counted([*goals, Goal(2.0, "a/2")], 3) == (1, 0)
    assert counted([*goals, Goal(2.0, "b/2")], 3) == (1, 0), "under another key it is a step too many"
    assert counted([*goals, goals[0]]) == (1, 0)


def test_the_longest_bar_is_the_longest_time() -> None:
    title, *bars = plot({"here": 30.0, "there": 1.0}, "a move").splitlines()
    assert title == "a move (logarithmic)"
    assert [bar.count("█") for bar in bars] == [demo_travel.BAR, 16]


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.story
@pytest.mark.timeout(400)
def test_robots_go_on_while_they_move_and_one_finds_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo_travel, "STEPS", 12)
    monkeypatch.setattr(demo_travel, "AGAIN", 1)
    asyncio.run(
        demo_sites.demo(
            headless=True, delay=LINE, realm="travels", speedup="10", key="none", make=demo_travel.Travel
        )
    )
    told = capsys.readouterr()
    said = json.loads(told.out.strip().splitlines()[-1])
    assert (said["twice"], said["lost"], said["trouble"]) == (0, 0, ""), said
    assert said["steps"] == 12
    assert said["smooth_s"].keys() == {
        "near the operator", "moved in between", "near the arm", "auto, until it is there", "auto",
    }, told.err  # fmt: skip
    assert said["lever_s"].keys() == said["smooth_s"].keys() - {"auto"}
    assert said["why"].startswith("plant:host-2 is nearer than host-1: its "), said
    assert said["faster"] > 1, said
