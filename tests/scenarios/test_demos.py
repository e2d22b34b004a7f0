"""The demos, played by real processes without a person: the last line of each says what came of it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from robotree.tui import demo_sites, demo_travel, exit_codes
from robotree.tui.cli import main
from robotree.tui.demo_crash import Goal
from robotree.tui.demo_travel import counted, plot
from tests.command_line import robotree

pytestmark = pytest.mark.timeout(900)
LINE = 60
"""[ms] one way."""


@pytest.fixture(autouse=True)
def folder(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a demo meet nobody, and leave its pictures in a folder of the test."""
    del place  # there before it, and longer
    monkeypatch.chdir(tmp_path)


def played(*words: str | Path) -> tuple[dict[str, Any], str]:
    """Play a demo to its good end; return its verdict, and what it told meanwhile."""
    done = robotree("demo", *words, "--headless", within=800)
    assert done.returncode == exit_codes.DONE, done.stdout[-2000:] + done.stderr[-2000:]
    verdict = json.loads(done.stdout.splitlines()[-1])
    assert verdict["ok"] is True
    return verdict, done.stderr


@pytest.mark.e2e
def test_an_assistant_closes_the_lever_with_one_permit_and_does_nothing_else() -> None:
    verdict, _ = played("mcp", "--speedup", "4")
    assert (verdict["permits"], verdict["stray"], verdict["trouble"]) == (1, 0, "")
    assert verdict["refused"] == 6
    assert verdict["moved"] > 0.3
    assert verdict["lever_angle_rad"] > 0.75
    assert "said yes" in verdict["why"]


@pytest.mark.e2e
def test_a_demo_whose_host_is_killed_closes_its_lever(tmp_path: Path) -> None:
    verdict, _ = played("--crash", "--speedup", "2", "--pictures", tmp_path / "here")
    assert (verdict["kills"], verdict["continued"]) == (2, 2)
    assert (verdict["twice"], verdict["lost"], verdict["doubts"]) == (0, 0, 0)


@pytest.mark.e2e
def test_the_demo_of_a_rover_that_is_away_ends_well() -> None:
    verdict, _ = played("away")
    assert (verdict["orders_away"], verdict["twice"], verdict["doubts"], verdict["kills"]) == (3, 0, 0, 1)


@pytest.mark.speed  # the hub must be back before a lease of 5 s ends, which beside other tests it is not
def test_the_lever_is_closed_from_another_site_while_the_hub_between_them_is_killed() -> None:
    verdict, told = played("sites", "--delay", "150", "--speedup", "4")
    assert (verdict["delay_ms"], verdict["hub_kills"]) == (150, 1)
    assert (verdict["twice"], verdict["lost"], verdict["doubts"], verdict["trouble"]) == (0, 0, 0, "")
    assert verdict["lever_angle_rad"] > 0.75
    assert 0 < verdict["peak_force_n"] < 35
    assert {"lever", "mover", "plant:arm-1"} <= set(verdict["stopped"])
    assert verdict["stop_s"] > 0.3, "an order goes there and its confirmation comes back"
    assert not Path(told.partition("XDG_RUNTIME_DIR=")[2].partition(" ")[0]).exists()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["sites", "--delay", "301"], "from 0 to 300"),
        (["sites", "--delay", "soon"], "from 0 to 300"),
        (["sites", "--can"], "course of its own"),
        (["--delay", "150"], "only `demo sites`"),
        (["plant"], "cell, companion, sites"),
    ],
)
def test_what_the_demo_cannot_do_is_refused_before_anything_begins(
    words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", *words, "--headless"]) != exit_codes.DONE
    assert reason in capsys.readouterr().err


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.parametrize("options", [["--can"], ["--can", "--classic"]], ids=["fd", "classic"])
def test_the_whole_demo_plays_over_can(options: list[str], tmp_path: Path) -> None:
    verdict, _ = played(*options, "--pictures", tmp_path / "pictures")
    assert verdict["lever_angle_rad"] > 0.75
    assert 0 < verdict["peak_force_n"] < 35
    assert len(verdict["pictures"]) == 2


@pytest.mark.soak
@pytest.mark.e2e
def test_an_evening_with_three_visitors_ends_well(tmp_path: Path) -> None:
    verdict, _ = played("companion", "--speedup", "3", "--pictures", tmp_path / "pictures")
    assert (verdict["greeted"], verdict["cups"], verdict["dropped"], verdict["left_early"]) == (3, 2, 1, 1)
    assert (verdict["role_changes"], verdict["stops"], verdict["refused"]) == (1, 1, 3)
    assert (verdict["interrupted"], verdict["spoken"]) == (1, "by mouth and ears")
    assert (verdict["orders"], verdict["errands"], verdict["chosen"]) == (1, 1, "cart-2")
    assert verdict["because"].startswith("cart-2 is free"), verdict["because"]
    assert "cart-1 carries out move" in verdict["because"], "it was asked for a bid, too"
    assert verdict["peak_force_n"] < 60


@pytest.mark.soak  # minutes of a simulated arm; tests/tui/composing has the parts of it in virtual time
@pytest.mark.e2e
def test_one_showing_becomes_a_page_that_carries_the_cup_also_from_another_place(tmp_path: Path) -> None:
    verdict, _ = played("compose", "--speedup", "4", "--pictures", tmp_path)
    assert verdict["moved"]
    assert verdict["moved_again"]
    assert verdict["lines"] <= 40
    assert verdict["steps"] < verdict["shown"] / 3
    assert {"cup.py", "cup.panel.yaml", "test_cup.py"} <= {path.name for path in tmp_path.iterdir()}


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
def test_robots_go_on_while_they_move_and_one_finds_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """How much faster they are near the arm depends on what else this machine does: docs/performance.md."""
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
