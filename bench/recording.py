"""What recording costs: the processor time of the recorder beside a cell.

    python bench/recording.py [--seconds 20]

The demo's cell with its arm in motion is recorded with the usual two pictures a second of each camera; the
figure is the processor time of the recorder as a share of one core, once it records.
"""

from __future__ import annotations

import asyncio
import sys
import time

from measuring import apart, cpu, options

from robotree.tui.demo import cast
from robotree.tui.processes.crew import Crew

REALM = "taped"
ROBOTREE = [sys.executable, "-m", "robotree.tui"]


async def record(seconds: float) -> None:
    """Print what `robotree record` costs."""
    with apart(REALM) as folder:
        async with Crew(REALM, folder) as crew:
            await cast(crew)
            recorder = await asyncio.create_subprocess_exec(
                *(*ROBOTREE, "record", str(folder / "it.mcap")), stderr=asyncio.subprocess.PIPE
            )
            assert recorder.stderr is not None  # noqa: S101 # a pipe
            await recorder.stderr.readline()
            await asyncio.sleep(2.0)
            before, began = cpu(recorder.pid), time.monotonic()
            await _move(seconds)
            used, lasted = cpu(recorder.pid) - before, time.monotonic() - began
            recorder.terminate()
            await recorder.wait()
            print(f"record: {used / lasted:.1%} of a core over {lasted:.0f} s")


async def _move(seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for height in ("0.3", "0.4"):
            call = ("call", "arm-1.go_to", "x=0.35", "y=0", f"z={height}", "twist=0")
            mover = await asyncio.create_subprocess_exec(
                *ROBOTREE, *call, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL
            )
            await mover.wait()


if __name__ == "__main__":
    asyncio.run(record(options(__doc__, seconds=20.0).seconds))
