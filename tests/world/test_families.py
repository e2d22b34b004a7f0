"""No seed of any family breaks a law: some are played here, many in `make soak`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.world.families import FAMILIES
from tests.world.many import go_on
from tests.world.threads import SCENES

MANY = {
    "realm": 500,
    "mesh": 1000,
    "mesh at statements": 500,
    "disk": 2000,
    "moves": 2000,
    "host": 1000,
    "host at statements": 300,
    "rights": 300,
    "hands": 300,
    "orders": 200,
    "groups": 200,
    "sites": 300,
    "whole": 300,
    "whole at statements": 60,
    **{f"threads of {scene}": 1000 for scene in SCENES},
}


def broken(family: str, seeds: range) -> list[tuple[int, list[str]]]:
    return [(seed, laws) for seed in seeds if (laws := FAMILIES[family](seed)[1])]


@pytest.mark.parametrize("family", ["mesh at statements", "host at statements"])
def test_no_seed_breaks_a_law_though_threads_lose_the_processor_before_any_statement(family: str) -> None:
    assert broken(family, range(8)) == []


@pytest.mark.parametrize("scene", SCENES)
def test_threads_that_meet_in_one_object_break_no_law(scene: str) -> None:
    assert broken(f"threads of {scene}", range(40)) == []


def test_a_seed_gives_one_scene() -> None:
    for scene in SCENES:
        play = FAMILIES[f"threads of {scene}"]
        assert play(3) == play(3)


def test_each_family_is_played_by_the_soak() -> None:
    assert MANY.keys() == FAMILIES.keys()


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("family", MANY)
def test_none_of_many_seeds_breaks_a_law(family: str) -> None:
    assert broken(family, range(MANY[family])) == []


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
