"""No seed of any family breaks a law, and each gives one trace: here, and in another process."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.command_line import ran
from tests.world.families import FAMILIES, go_on
from tests.world.story import play

ROOT = Path(__file__).resolve().parents[2]
DIGEST = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from tests.world.story import play
print(play(1).digest)
"""


@pytest.mark.parametrize("name", [name for name, family in FAMILIES.items() if family.seeds])
def test_no_seed_breaks_a_law_and_each_gives_one_trace(name: str, caplog: pytest.LogCaptureFixture) -> None:
    """Nothing is logged as an error, either: a robot that a person commands publishes its state."""
    family = FAMILIES[name]
    played = {seed: family.play(seed) for seed in family.seeds}
    assert {seed: story.broken for seed, (_, story) in played.items() if story.broken} == {}
    assert family.lively([story for _, story in played.values()])
    first = family.seeds[0]
    assert family.play(first)[0] == played[first][0]
    assert not [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]


@pytest.fixture(scope="module")
def digest() -> str:
    return play(1).digest


def test_a_seed_gives_the_same_trace_in_another_process(tmp_path: Path, digest: str) -> None:
    """Whatever the order of sets of strings is there, and the folder in which it runs."""
    run = ran(
        [sys.executable, "-c", DIGEST], check=True, cwd=tmp_path, env={**os.environ, "PYTHONHASHSEED": "1"}
    )
    assert run.stdout.strip() == digest


def test_robots_that_go_on_from_their_encoded_states_do_the_same(digest: str) -> None:
    """At two hundred moments every robot of the realm goes on from what is decoded from its encoding."""
    assert play(1, reloads=200).digest == digest


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("family", FAMILIES)
def test_none_of_many_seeds_breaks_a_law(family: str) -> None:
    play = FAMILIES[family]
    assert [(seed, laws) for seed in range(play.many) if (laws := play(seed)[1])] == []


def test_a_night_goes_on_behind_the_last_seed_and_a_bad_seed_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seeds: list[int] = []

    def play(seed: int) -> tuple[str, list[str]]:
        seeds.append(seed)
        return "", ["a law", "another law"] if seed == 4 else []

    for _ in range(2):
        ticks = iter([0.0, 1.0, 1.5, 2.0])  # three seeds of the only family
        wrong = go_on({"one": play}, 2.0, tmp_path / "seeds", lambda ticks=ticks: next(ticks))
    assert seeds == [0, 1, 2, 3, 4, 5]
    assert wrong == 1
    assert "one: seed 4: a law\n" in capsys.readouterr().out
