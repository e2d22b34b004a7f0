"""Ever new seeds of all families, night after night.

    python -m tests.world.many SECONDS FILE

Each family has the same time. FILE keeps how many seeds of each were played, and the command goes on behind
them. A seed that breaks a law is one line: its family, its number, and the law.
"""

from __future__ import annotations

import gc
import json
import logging
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from tests.world.families import FAMILIES, Played

COLLECTED = 50
"""Stories after which what they have left is collected."""


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
