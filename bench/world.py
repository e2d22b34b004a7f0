"""How many stories the World plays in a second on one core, whether each repeats, and what they run.

A story: 60 s of virtual time, 2 lookup services, 3 hosts with 3 virtual robots, 4 proxies whose controllers
run the real firmware, two operators, and up to 12 faults (tests/world/story.py). Each seed is played twice.

    python bench/world.py [SEEDS [FIRST]]        figures of the realm over the modelled network
    python bench/world.py families [SEEDS]       for each family: stories a second, seeds that break a law;
        and which functions of the network of one machine ran in none of them
    python bench/world.py safeguards [SEEDS [WORD …]]
        the first seed of each family that breaks a law without each safeguard or lock whose name has a WORD
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
from types import CodeType

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the stories lie beside the tests

from tests.world.families import FAMILIES, network
from tests.world.points import codes_of
from tests.world.safeguards import SAFEGUARDS, without
from tests.world.story import LENGTH, Outcome, play

SLOWER = {"realm": 6, "disk": 2, "host": 2, "host at statements": 4, "whole": 20, "whole at statements": 40}
"""By how much fewer stories of a family are played, as they take longer."""
COUNTED = ("mesh", "host", "whole")
"""Families over the network of one machine, without points at statements."""


def search(seeds: int, words: list[str]) -> int:
    """Print the first seed that breaks a law without each safeguard; returns how many none of them caught."""
    missing = 0
    for safeguard in SAFEGUARDS:
        if words and not any(word in safeguard for word in words):
            continue
        found = next((line for family in FAMILIES if (line := _first(safeguard, family, seeds))), "")
        missing += not found
        print(f"{safeguard}: {found or f'no seed of {seeds}'}", flush=True)
    return missing


def _first(safeguard: str, family: str, seeds: int) -> str:
    for seed in range(seeds // SLOWER.get(family, 1)):
        with without(safeguard):
            broken = FAMILIES[family](seed)[1]
        if broken and not FAMILIES[family](seed)[1]:
            return f'("{family}", {seed})  # {broken[0]}'
    return ""


def measure_families(seeds: int) -> int:
    """Print the speed of each family, and the share of the network's functions that they ran.

    Returns:
        How many seeds broke a law.
    """
    wanted = {code: name for module in network() for code, name in codes_of(module).items()}
    ran: set[CodeType] = set()
    broken = 0
    for family, play_one in FAMILIES.items():
        play_one(0)
        gc.collect()
        gc.freeze()
        count, taken = max(seeds // SLOWER.get(family, 1), 1), list[float]()
        for seed in range(count):
            begin = time.process_time()
            laws = play_one(seed)[1]
            taken.append(time.process_time() - begin)
            broken += bool(laws)
            if laws:
                print(f"{family}: seed {seed}: {laws[0]}")
        print(f"{family:30} {count:5} stories, {1 / statistics.median(taken):7.1f} a second")
        if family in COUNTED:
            sys.setprofile(lambda frame, event, _: event == "call" and ran.add(frame.f_code))
            for seed in range(count):
                play_one(seed)
            sys.setprofile(None)
            print(f"{'':30} {len(ran & wanted.keys())} of {len(wanted)} functions of the network ran")
    share = len(ran & wanted.keys()) / len(wanted)
    print(f"functions of the network that ran under seeds: {share:.1%}; those that did not:")
    print(", ".join(sorted(wanted[code] for code in wanted.keys() - ran)))
    print(f"seeds that broke a law: {broken}")
    return broken


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
        return search(int(words[1]) if len(words) > 1 else 100, words[2:])
    if words[:1] == ["families"]:
        return measure_families(int(words[1]) if len(words) > 1 else 60)
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
