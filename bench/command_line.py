"""Measures how long a person waits for the command line, against a Python that does nothing.

    python bench/command_line.py [ROUNDS]

All are started in turns, so that they meet the same machine; medians. `ls`, `tree` and `show` ask the demo's
eight processes. Promised: `--help` 80 ms, `ls` 150 ms. Python keeps what it has compiled, as by default.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import subprocess
import sys
from pathlib import Path

from measuring import apart, clock, count_given

from robotree.tui.demo import cast
from robotree.tui.processes.crew import Crew

REALM = "bench"
ROUNDS = 15
ROBOTREE = [str(Path(sys.executable).with_name("robotree"))]
BARE = "python -c pass"
CASES: dict[str, tuple[list[str], float]] = {
    "python -S -c pass": ([sys.executable, "-S", "-c", "pass"], float("inf")),
    BARE: ([sys.executable, "-c", "pass"], float("inf")),
    "import asyncio, msgspec": ([sys.executable, "-c", "import asyncio, msgspec"], float("inf")),
    "robotree --help": ([*ROBOTREE, "--help"], 0.08),
    "robotree help call": ([*ROBOTREE, "help", "call"], 0.08),
    "robotree fly": ([*ROBOTREE, "fly"], 0.08),
    "robotree ls": ([*ROBOTREE, "ls"], 0.15),
    "robotree tree": ([*ROBOTREE, "tree"], 0.25),
    "robotree show arm-1": ([*ROBOTREE, "show", "arm-1"], 0.25),
    "robotree doctor": ([*ROBOTREE, "doctor"], float("inf")),
}
"""What is started, and how long it may take [s]."""


def once(words: list[str]) -> None:
    """Start one, and wait for its end."""
    subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


def measure(rounds: int) -> None:
    """Take turns and print the medians."""
    took: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(rounds):
        for name, (words, _) in CASES.items():
            took[name] += clock(lambda words=words: once(words), 1)
    bare = statistics.median(took[BARE]) / 1e6
    for name, (_, promised) in CASES.items():
        median = statistics.median(took[name]) / 1e6
        kept = "kept" if median <= promised else "NOT kept"
        bound = "" if promised == float("inf") else f"  of {promised * 1e3:.0f}: {kept}"
        fastest = min(took[name]) / 1e3
        times = f"{median * 1e3:6.0f} ms  fastest {fastest:5.0f}  {median / bare:5.1f} times bare"
        print(f"{name:<24} {times}{bound}")


async def main(rounds: int) -> None:
    """Measure beside the demo's cast."""
    async with Crew(REALM) as crew:
        await cast(crew)
        await asyncio.to_thread(measure, rounds)


if __name__ == "__main__":
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with apart(REALM):
        asyncio.run(main(count_given(1, ROUNDS)))
