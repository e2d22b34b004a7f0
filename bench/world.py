"""How many stories of a whole realm the World plays in a second on one core, and whether each repeats.

A story: 60 s of virtual time, 2 lookup services, 3 hosts with 3 virtual robots, 4 proxies whose controllers
run the real firmware, two operators, and up to 12 faults (tests/world/story.py). Each seed is played twice.

    python bench/world.py [SEEDS [FIRST]]        figures
    python bench/world.py safeguards [SEEDS]     the first seed that breaks a law without each safeguard
    python bench/world.py traces SEEDS SECONDS FILE
        compare the traces of seeds that are played twice, for SECONDS [s] at most: here and in a second
        process, where strings and objects have other hashes. FILE has a line for each seed, and the command
        goes on behind its last one. A trace has every message, every frame on a cable, and every event and
        effect of every robot.
    python bench/world.py digests FIRST SEEDS    a line for each seed: its number and the digest of its trace
"""

from __future__ import annotations

import gc
import logging
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the stories lie beside the tests

from tests.world.safeguards import SAFEGUARDS, without
from tests.world.story import LENGTH, Outcome, play


def search(seeds: int) -> int:
    """Print the first seed that breaks a law without each safeguard; returns how many none of them caught."""
    missing = 0
    for safeguard in SAFEGUARDS:
        for seed in range(seeds):
            with without(safeguard):
                broken = play(seed).broken
            if broken:
                print(f"{safeguard}: seed {seed}: {broken[0]}", flush=True)
                break
        else:
            missing += 1
            print(f"{safeguard}: no seed of {seeds}", flush=True)
    return missing


@contextmanager
def elsewhere(first: int, seeds: int) -> Generator[Generator[str]]:
    """Play seeds in a process with other hashes; gives the digest of each, from the first one."""
    command = [sys.executable, __file__, "digests", str(first), str(seeds)]
    environment = {**os.environ, "PYTHONHASHSEED": str(1 + first)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None  # noqa: S101 # it is a pipe
        try:
            yield (line.split()[1] for line in process.stdout)
        finally:
            process.kill()


def _play(seed: int) -> Outcome:
    """Play one of many seeds; what the stories before it have left is collected now and then."""
    if seed % 50 == 0:
        gc.collect()
    return play(seed)


def tell_digests(first: int, seeds: int) -> int:
    """Print a line for each seed; returns how many broke a law."""
    broken = 0
    for seed in range(first, seeds):
        outcome = _play(seed)
        broken += bool(outcome.broken)
        print(seed, outcome.digest, flush=True)
    return broken


def compare(seeds: int, seconds: float, file: Path) -> int:
    """Play seeds twice until the time is over; returns how many were not the same or broke a law."""
    known = file.read_text().splitlines() if file.exists() else []
    end = time.monotonic() + seconds
    with file.open("a") as out, elsewhere(len(known), seeds) as digests:
        for seed in range(len(known), seeds):
            if time.monotonic() > end:
                break
            one, other = _play(seed), next(digests)
            same = "same" if one.digest == other else f"other {other}"
            known.append(f"{seed} {one.digest} {same} {'; '.join(one.broken) or 'lawful'}")
            out.write(f"{known[-1]}\n")
            out.flush()
    identical = sum(" same " in line for line in known)
    lawful = sum(line.endswith(" lawful") for line in known)
    print(f"{identical} of {len(known)} traces identical twice; {lawful} broke no law; {seeds} asked for")
    return 2 * len(known) - identical - lawful


def main() -> int:
    """Do what the command line asks for; returns how much of it failed."""
    logging.disable(logging.CRITICAL)
    words = sys.argv[1:]
    if not {"-h", "--help"}.isdisjoint(words):
        print(__doc__)
        return 0
    if words[:1] == ["traces"]:
        return compare(int(words[1]), float(words[2]), Path(words[3]))
    if words[:1] == ["digests"]:
        return tell_digests(int(words[1]), int(words[2]))
    if words[:1] == ["safeguards"]:
        return search(int(words[1]) if len(words) > 1 else 100)
    return measure(int(words[0]) if words else 20, int(words[1]) if len(words) > 1 else 0)


def measure(seeds: int, first: int) -> int:
    """Play seeds twice and print figures; returns how many broke a law or were not the same twice."""
    play(first)  # imports, caches
    gc.freeze()
    taken: list[float] = []
    identical = events = faults = 0
    broken: list[int] = []
    for seed in range(first, first + seeds):
        digests: list[str] = []
        for _ in range(2):
            begin = time.process_time()
            outcome = play(seed)
            taken.append(time.process_time() - begin)
            digests.append(outcome.digest)
        identical += digests[0] == digests[1]
        events, faults = events + outcome.events, faults + outcome.faults
        if outcome.broken:
            broken.append(seed)
            print(f"seed {seed}: {'; '.join(outcome.broken)}")
    median = statistics.median(taken)
    print(f"seeds played twice            {seeds:10}")
    print(f"identical traces              {identical:10}")
    print(f"seeds that broke a law        {len(broken):10}")
    print(f"processor time of a story     {1000 * median:10.0f} ms (median)")
    print(f"stories a second on one core  {1 / median:10.1f}")
    print(f"virtual time : processor time {LENGTH / median:10.0f}")
    print(f"events traced a story         {events / seeds:10.0f}")
    print(f"faults a story                {faults / seeds:10.1f}")
    return len(broken) + seeds - identical


if __name__ == "__main__":
    sys.exit(main() > 0)
