"""What recording and replaying cost.

    python bench/recording.py record [--seconds 20]   processor time of the recorder beside a cell
    python bench/recording.py replay [--hours 8]      memory of the full screen over a long recording

`record` starts the demo's cell with its arm in motion and records it with the usual two pictures a second of
each camera; the figure is the processor time of the recorder as a share of one core, once it records.
`replay` writes a recording in which three robots speak once a second, each says a line a minute and a camera
has a picture a minute, opens it in the full screen, and goes through it as fast as the screen takes it; the
figures are the resident memory after each eighth.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import os
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import psutil

STEP = 10.0
"""[s] of the recording that are played at once."""


async def record(seconds: float) -> None:
    """Print what `robotree record` costs."""
    from robotree.tui.demo import cast
    from robotree.tui.processes.crew import Crew

    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        for variable in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME"):
            os.environ[variable] = folder
        os.environ.pop("ROBOTREE_REALM", None)
        async with Crew("taped", Path(folder)) as crew:
            await cast(crew)
            words = [sys.executable, "-m", "robotree.tui"]
            file = Path(folder, "it.mcap")
            recorder = await asyncio.create_subprocess_exec(
                *(*words, "record", str(file), "--realm", "taped"), stderr=asyncio.subprocess.PIPE
            )
            assert recorder.stderr is not None  # noqa: S101 # a pipe
            await recorder.stderr.readline()
            await asyncio.sleep(2.0)
            moving = asyncio.create_task(_move(words, seconds))
            process = psutil.Process(recorder.pid)
            before, began = process.cpu_times(), time.monotonic()
            await moving
            after, lasted = process.cpu_times(), time.monotonic() - began
            used = after.user + after.system - before.user - before.system
            recorder.terminate()
            await recorder.wait()
            print(f"record: {used / lasted:.1%} of a core over {lasted:.0f} s")


async def _move(words: list[str], seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for height in ("0.3", "0.4"):
            call = ("call", "arm-1.go_to", "x=0.35", "y=0", f"z={height}", "twist=0", "--realm", "taped")
            mover = await asyncio.create_subprocess_exec(
                *words, *call, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL
            )
            await mover.wait()


def _written(hours: float) -> io.BytesIO:
    from robotree.tui.recording.tape import TapeWriter
    from robotree.vr.base.address import Address
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.requests import LoggedLine, Picture, State

    noon, stream = 1_800_000_000.0, io.BytesIO()
    writer = TapeWriter(stream, {"realm": "bench", "began": repr(noon)})
    names = [f"arm-{number}" for number in range(3)]
    for name in names:
        writer.description(noon, RobotDescription(address=Address("robot", name, "1"), kinds=("Arm",)))
    from PIL import Image

    jpeg = io.BytesIO()
    Image.new("RGB", (480, 270)).save(jpeg, "JPEG")
    picture = Picture(jpeg=jpeg.getvalue(), width=480, height=270, camera="cell")
    for second in range(int(hours * 3600)):
        for name in names:
            readings = {"x": second % 10 / 10, "y": 0.0, "z": second % 7 / 10, "twist": 0.0}
            writer.state(noon + second, name, State(readings=readings))
            if second % 60 == 0:
                writer.line(name, LoggedLine(second, noon + second, "info", f"minute {second // 60}"))
        if second % 60 == 0:
            writer.picture(noon + second, "cell", picture)
    writer.close()
    stream.seek(0)
    return stream


async def replay(hours: float) -> None:
    """Print how the memory of a replay grows."""
    from robotree.tui.recording import tape
    from robotree.tui.recording.replaying import Player, Replay
    from robotree.vr.supervision.realm_client import RealmClient

    player = Player(tape.read(_written(hours), "bench.mcap"), 1.0)
    player.held = True
    realm_client = RealmClient(player.open())
    await realm_client.start()
    app = partial(Replay, player)(realm_client, realm="", readonly=True)
    process, found = psutil.Process(), list[str]()
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.pause(1.0)
        steps = int(hours * 3600 / STEP)
        began = time.monotonic()
        for step in range(1, steps + 1):
            player.go_to(player.playback.position + STEP)
            await asyncio.sleep(0.0)
            if step % (steps // 8) == 0:
                await pilot.pause(0.2)
                found.append(f"{process.memory_info().rss / 1e6:.0f}")
        lasted = time.monotonic() - began
    await realm_client.close()
    speed = hours * 3600 / lasted
    print(f"replay: {hours:g} h at {speed:.0f} times its speed; MB after each eighth: {', '.join(found)}")


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", choices=["record", "replay"])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--hours", type=float, default=8.0)
    given = parser.parse_args()
    asyncio.run(record(given.seconds) if given.what == "record" else replay(given.hours))


if __name__ == "__main__":
    main()
