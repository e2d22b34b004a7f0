"""No seed of any family breaks a law: some are played here, many in `make soak`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.world.families import FAMILIES, STORIES
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


SEEDS: dict[str, Sequence[int]] = {
    "realm": (
        186,  # two commands wait for a child that is lost: they end in the order in which they called it
        0,
        177,  # an operator's program is paused when it is to call: the deadline begins when it goes on
        2236,  # a command is cancelled between two of its steps, where threads would be interrupted
        1185,  # a cancel gets NoAnswer, and the call begins when the process of the robot goes on
    ),
    "mesh": range(10),  # in 5 the realm's folder is lost while the disk is full
    "mesh at statements": range(4),
    "disk": (
        *range(8),
        14,  # a disk is read-only: what can neither be written nor removed is not to become untrue
        5157,  # the next host ends, too, when its own file is written and a torn one is not yet removed
        20249,  # a command ends at its deadline, while one of its parts waits until another has asked
    ),
    "moves": (*range(8), 61),  # a parent renews its lease with the process that its child is just leaving
    "host": range(8),
    "host at statements": range(4),
    "rights": range(1),
    "hands": range(2),
    "orders": range(2, 6),
    "groups": (0, 1, 4),  # in 4 a question ends by its limit
    "sites": range(2),
    "whole": (4,),
    **{f"threads of {scene}": range(20) for scene in SCENES},
}
"""Those that are played here, besides the one of each safeguard; the first one twice."""
LIVELY: dict[str, Callable[[list[Any]], bool]] = {
    "mesh": lambda played: all(one.faults and one.answered > 25 for one in played),
    "disk": lambda played: sum(one.ends for one in played) > 8 and sum(one.done for one in played) > 30,
    "moves": lambda played: sum(one.moved for one in played) > 8,
    "host": lambda played: all(one.deeds and one.done > 5 for one in played),
    "rights": lambda played: all(len(one.tickets) > 10 for one in played),
    "hands": lambda played: all(one.steps > 50 and one.told > 5 and one.tickets for one in played),
    "orders": lambda played: sum(len(one.begun) for one in played) > 15,
    "groups": lambda played: (
        all(one.reached >= 4 and one.failures >= 10 and one.counted >= 5 for one in played)
        and any(one.ends["nobody"] for one in played)
        and sum(one.crossed for one in played) >= 3
    ),
    "sites": lambda played: sum(one.begun for one in played) > 10,
    "whole": lambda played: all(one.faults and len(one.realm.begun) > 10 for one in played),
}
"""Whether the stories of a family are some: robots work between the faults."""


@pytest.mark.parametrize("family", SEEDS)
def test_no_seed_breaks_a_law_and_each_gives_one_trace(family: str, caplog: pytest.LogCaptureFixture) -> None:
    """Nothing is logged as an error, either: a robot that a person commands publishes its state."""
    play, seeds = STORIES[family], SEEDS[family]
    played = {seed: play(seed) for seed in seeds}
    assert {seed: story.broken for seed, (_, story) in played.items() if story.broken} == {}
    assert LIVELY.get(family, bool)([story for _, story in played.values()])
    assert play(seeds[0])[0] == played[seeds[0]][0]
    assert not [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]


def test_each_family_is_played_by_the_soak() -> None:
    assert MANY.keys() == FAMILIES.keys()


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("family", MANY)
def test_none_of_many_seeds_breaks_a_law(family: str) -> None:
    assert [(seed, laws) for seed in range(MANY[family]) if (laws := FAMILIES[family](seed)[1])] == []


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
