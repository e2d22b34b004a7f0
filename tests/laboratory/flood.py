"""How long a stop of a hundred robots takes while pictures flood a line of 64 kbit/s with 3 % loss.

    python -m tests.laboratory.flood [--rate 64000] [--loss 0.03] [--rounds 3]

A desk and a plant, each with such a line to the hub between them, with the real processes. It prints how long
each stop took until all robots had confirmed it, or what was not confirmed, and at which rate pictures came.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from robotree.vr.base.errors import VrError
from tests.laboratory.laboratory import PAGES, joined_in
from tests.laboratory.test_far_site import Far
from tests.waiting import until

CROWD = 100
"""Robots that are stopped."""
TAKERS = 3
"""How many at the desk take pictures, each one after the other."""


async def flooded(far: Far, rate: float, loss: float, rounds: int) -> None:
    """Have pictures flood the line, and stop all robots now and then."""
    async with joined_in(Path(far.plant.environment["XDG_RUNTIME_DIR"]), "plant") as there:
        for number in range(CROWD):
            await there.create(str(PAGES), f"leaf-{number}", "host-2", "Leaf")
    async with joined_in(Path(far.desk.environment["XDG_RUNTIME_DIR"]), "plant") as here:
        await until(lambda: len(here.present("robot")) > CROWD, "all are seen")
        far.line.be(delay=0.02, rate=rate, loss=loss)
        sizes, over = list[int](), asyncio.Event()

        async def look() -> None:
            while not over.is_set():
                with suppress(VrError):
                    sizes.append(len((await here.look("cell", width=160, height=90, quality=60)).jpeg))

        looking = [asyncio.ensure_future(look()) for _ in range(TAKERS)]
        began = time.monotonic()
        await until(lambda: len(sizes) >= TAKERS, "the line is full of pictures")
        for _ in range(rounds):
            ordered = time.monotonic()
            try:
                stopped = await here.stop(None)
                said = f"{sum('leaf-' in one for one in stopped)} robots have confirmed"
            except VrError as error:
                said = str(error)[:200]
            sys.stdout.write(f"stop: {time.monotonic() - ordered:.2f} s: {said}\n")
            await asyncio.sleep(5.0)
        shown, seconds = list(sizes), time.monotonic() - began
        sys.stdout.write(f"{len(shown)} pictures in {seconds:.0f} s: {sum(shown) * 8 / seconds:.0f} bit/s\n")
        over.set()
        far.line.be()
        await asyncio.gather(*looking)


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.laboratory.flood", description=__doc__)
    parser.add_argument("--rate", type=float, default=64_000.0)
    parser.add_argument("--loss", type=float, default=0.03)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        far = Far(Path(folder))
        try:
            far.plant.start("host", "host", "host-2")
            asyncio.run(flooded(far, given.rate, given.loss, given.rounds))
        finally:
            far.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
