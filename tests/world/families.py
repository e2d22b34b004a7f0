"""The families of stories: a seed plays one story of a family, which breaks laws or does not.

    python -m tests.world.families SECONDS FILE

plays ever new seeds of all families, night after night. Each family has the same time. FILE keeps how many
seeds of each were played, and the command goes on behind them. A seed that breaks a law is one line: its
family, its number, and the law.
"""

from __future__ import annotations

import gc
import importlib
import json
import logging
import pkgutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import robotree.vr.network
import robotree.vr.running
from robotree.vr.agents import callers
from robotree.vr.base import presence
from tests.world import crashes, groups, host, mesh, moves, orders, rights, sites, story, threads, whole

Played = tuple[str, list[str]]
"""The digest of a trace, and the laws that were broken."""
COLLECTED = 50
"""Stories after which what they have left is collected."""


@dataclass(frozen=True)
class Family:
    """Stories of one kind."""

    play: Callable[[int], tuple[str, Any]]
    """Plays the story of a seed; gives the digest of its trace, and what has `broken`: the laws."""
    many: int
    """Seeds that `make soak` plays each time."""
    seeds: Sequence[int]
    """Those that `make test` plays, besides the one of each safeguard; the first one twice."""
    lively: Callable[[list[Any]], bool] = bool
    """Whether these stories are some: robots work between the faults."""

    def __call__(self, seed: int) -> Played:
        digest, played = self.play(seed)
        return digest, played.broken


@cache
def network() -> tuple[ModuleType, ...]:
    """Return the modules of the network, and its table of who is there."""
    return (presence, *_modules_of(robotree.vr.network))


@cache
def running() -> tuple[ModuleType, ...]:
    """Return the modules that carry out the code of robots."""
    return (callers, *_modules_of(robotree.vr.running))


def _modules_of(package: ModuleType) -> list[ModuleType]:
    names = (module.name for module in pkgutil.iter_modules(package.__path__) if not module.ispkg)
    return [importlib.import_module(f"{package.__name__}.{name}") for name in names]


def _realm(seed: int) -> tuple[str, story.Outcome]:
    outcome = story.play(seed)
    return outcome.digest, outcome


FAMILIES: dict[str, Family] = {
    "realm": Family(
        _realm,
        500,
        (
            186,  # two commands wait for a child that is lost: they end in the order in which they called it
            177,  # an operator's program is paused when it is to call: the deadline begins when it goes on
            2236,  # a command is cancelled between two of its steps, where threads would be interrupted
            1185,  # a cancel gets NoAnswer, and the call begins when the process of the robot goes on
        ),
    ),
    "mesh": Family(
        mesh.play,
        1000,
        (5, 1, 2),  # in 5 the realm's folder is lost while the disk is full
        lambda played: all(one.faults and one.answered > 25 for one in played),
    ),
    "mesh at statements": Family(lambda seed: mesh.play(seed, network()), 500, range(2)),
    "disk": Family(
        crashes.play,
        2000,
        (
            2,
            3,
            14,  # a disk is read-only: what can neither be written nor removed is not to become untrue
            5157,  # the next host ends, too, when its own file is written and a torn one is not yet removed
            20249,  # a command ends at its deadline, while one of its parts waits until another has asked
        ),
        lambda played: sum(one.ends for one in played) > 8 and sum(one.done for one in played) > 12,
    ),
    "moves": Family(
        moves.play,
        2000,
        (0, 2, 3, 61),  # a parent renews its lease with the process that its child is just leaving
        lambda played: sum(one.moved for one in played) > 8,
    ),
    "host": Family(
        host.play, 1000, range(3), lambda played: all(one.deeds and one.done > 5 for one in played)
    ),
    "host at statements": Family(lambda seed: host.play(seed, running()), 300, range(2)),
    "rights": Family(
        rights.play_rights, 300, range(1), lambda played: all(len(one.tickets) > 10 for one in played)
    ),
    "hands": Family(
        rights.play_hands,
        300,
        (1,),
        lambda played: all(one.steps > 50 and one.told > 5 and one.tickets for one in played),
    ),
    "orders": Family(orders.play, 200, (2, 3), lambda played: sum(len(one.begun) for one in played) > 8),
    "groups": Family(
        groups.play,
        200,
        (4, 1),  # in 4 a question ends by its limit
        lambda played: (
            all(one.reached >= 4 and one.failures >= 10 and one.counted >= 5 for one in played)
            and any(one.ends["nobody"] for one in played)
            and sum(one.crossed for one in played) >= 3
        ),
    ),
    "sites": Family(sites.play, 300, (1,), lambda played: sum(one.begun for one in played) > 10),
    "whole": Family(
        whole.play, 300, (4,), lambda played: all(one.faults and len(one.realm.begun) > 10 for one in played)
    ),
    "whole at statements": Family(lambda seed: whole.play(seed, (*network(), *running())), 60, ()),
    **{
        f"threads of {scene}": Family(partial(threads.play, scene), 1000, range(20))
        for scene in threads.SCENES
    },
}
"""By name. "At statements": threads lose the processor before any statement, too."""


def tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def go_on(
    families: Mapping[str, Callable[[int], Played]],
    seconds: float,
    file: Path,
    clock: Callable[[], float] = time.monotonic,
) -> int:
    """Play the next seeds of each family; at least one of each.

    Args:
        families: as `FAMILIES`.
        seconds: for all together.
        file: keeps how many seeds of each were played.
        clock: [s]

    Returns:
        How many broke a law.
    """
    played: dict[str, int] = json.loads(file.read_text()) if file.exists() else {}
    broken = 0
    for family, play in families.items():
        ends = clock() + seconds / len(families)
        while True:
            seed = played.get(family, 0)
            if laws := play(seed)[1]:
                broken += 1
                tell(f"{family}: seed {seed}: {laws[0]}")
            played[family] = seed + 1
            if seed % COLLECTED == COLLECTED - 1:
                gc.collect()
            if clock() >= ends:
                break
        file.write_text(json.dumps(played, indent=1))
        tell(f"{family}: {played[family]} seeds so far")
    tell(f"{sum(played.values())} seeds so far; {broken} of those of this run broke a law")
    return broken


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    sys.exit(go_on(FAMILIES, float(sys.argv[1]), Path(sys.argv[2])) > 0)
