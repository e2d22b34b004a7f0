"""`robotree wire record --connect URL FILE`: listen to a link and keep every frame, silently."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path
from typing import BinaryIO

from robotree.protocol.capture.errors import BadRecording
from robotree.protocol.capture.recorder import Recorder, writer_of
from robotree.protocol.errors import LinkError
from robotree.protocol.links.url import connect
from robotree.tui.grammar import Line
from robotree.tui.terminal import note, put
from robotree.tui.wire.lasting import Lasting, lasting


class Tape:
    """A handler that records."""

    def __init__(self, recorder: Recorder, here: Lasting) -> None:
        """Record until `here` is over."""
        self._recorder, self._here = recorder, here

    def received(self, data: bytes) -> None:
        """Keep what came."""
        if not self._here.over:
            self._recorder.take(data, time.time())

    def closed(self, reason: LinkError) -> None:
        """Nothing more will come."""
        self._here.end(reason)


def run(line: Line) -> int:
    """Record until the end, and say how much it was."""
    name = line.text("FILE")
    make = writer_of(name)
    with _created(name) as file:
        return asyncio.run(_record(line, Recorder(make(file))))


def _created(name: str) -> BinaryIO:
    try:
        return Path(name).open("xb")
    except FileExistsError as error:
        raise BadRecording(name, "exists already, and recordings are not overwritten") from error
    except OSError as error:
        raise BadRecording(name, f"cannot be written: {error.strerror}") from error


async def _record(line: Line, recorder: Recorder) -> int:
    began = time.monotonic()
    async with lasting(line) as here:
        link = await connect(line.text("--connect"), lambda _: Tape(recorder, here))
        note(f"recording {link.address}; Ctrl-C ends it")
        await here.wait()
        link.close()
    recorder.close()
    seconds = time.monotonic() - began
    if line.flag("--json"):
        told = {"frames": recorder.frames, "skipped": recorder.skipped, "withheld": recorder.withheld}
        put(json.dumps({"file": line.text("FILE"), **told, "seconds": round(seconds, 3)}))
    else:
        skipped = f"; {recorder.skipped} bytes were no frame" if recorder.skipped else ""
        withheld = f"; {recorder.withheld} with keys were left out" if recorder.withheld else ""
        put(f"{line.text('FILE')}: {recorder.frames} frames in {seconds:.1f} s{skipped}{withheld}")
    return here.exit_code()
