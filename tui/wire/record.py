"""`robotree wire record --connect URL FILE`: keep every frame that a link brings."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from robotree.protocol.dialect.extension import extend
from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link
from robotree.protocol.links.rejection import rejection
from robotree.protocol.links.security import LinkSecurity
from robotree.protocol.links.url import connect
from robotree.protocol.services.heartbeat import PERIOD
from robotree.protocol.tools.capture.files import Recording
from robotree.protocol.tools.capture.recorder import Recorder, writer_of
from robotree.protocol.tools.capture.records import BadRecording
from robotree.tui import exit_codes
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import complain, note, put
from robotree.tui.wire.identity import COMPONENT, SYSTEM, heartbeat
from robotree.tui.wire.lasting import Lasting, lasting
from robotree.tui.wire.security import securing

LARGEST_COUNTED = 32 * 1024 * 1024
"""[bytes] of a recording that is read again to count what is kept, in seconds; more would take minutes."""


class Tape:
    """A handler that records what comes, believed or not, and says once a second that we are there."""

    def __init__(self, link: Link, here: Lasting, security: LinkSecurity) -> None:
        """Keep what comes until there is a recorder."""
        self._here, self._early = here, bytearray()
        self._recorder: Recorder | None = None
        signer_pair = security.signer_pair(link.controller)
        self._verifier = signer_pair["verifier"]
        self._mouth = Endpoint(
            link, system=SYSTEM, component=COMPONENT, on_frame=lambda _: None, **signer_pair
        )

    @property
    def rejection(self) -> str:
        """The mistake in the keys; empty: there is none."""
        return "" if self._mouth.statistics.received else rejection(self._verifier)

    def begin(self, recorder: Recorder) -> None:
        """Record from now on, and what came before."""
        self._recorder = recorder
        self._keep(bytes(self._early))

    def speak(self) -> None:
        """Send a heartbeat: a robot that listens on a port does not know us before."""
        self._mouth.send(heartbeat(), telemetry=True)

    def received(self, data: bytes) -> None:
        """Keep what came."""
        if self._here.over:
            return
        self._mouth.received(data)
        if self._recorder is None:
            self._early += data
        else:
            self._keep(data)

    def closed(self, reason: LinkError) -> None:
        """Nothing more will come."""
        self._here.end(reason)

    def _keep(self, data: bytes) -> None:
        try:
            if self._recorder is not None:
                self._recorder.take(data, time.time())
        except OSError as error:  # the link must not take it for its own
            self._here.end(error)


def record(line: Line, _realm: str) -> int:
    """Record until the end, and say how much it was."""
    name = line.text("FILE")
    writer_of(name)
    if line.text("--xml"):
        extend(Path(line.text("--xml")))
    if Path(name).exists():
        raise _exists(name)
    return asyncio.run(_record(line))


def _exists(name: str) -> BadRecording:
    return BadRecording(name, "exists already, and recordings are not overwritten")


def _created(name: str) -> BinaryIO:
    try:
        return Path(name).open("xb")
    except FileExistsError as error:
        raise _exists(name) from error
    except OSError as error:
        raise BadRecording(name, f"cannot be written: {error.strerror}") from error


def _kept(file: BinaryIO) -> str:
    """How much of a recording that ended for want of space can be read."""
    with suppress(OSError):  # what waits in the program's own buffer finds no room
        file.close()
    path = Path(file.name)
    if not path.is_file():
        return "what was written before is out"
    if path.stat().st_size > LARGEST_COUNTED:
        return "what was written before is kept"
    count = sum(len(batch) for batch in Recording(str(path)).frames())
    return f"the first {count} frames are kept" if count else "nothing is kept"


def _drop(name: str) -> None:
    """Remove an empty recording: it is of no use, and would be in the way of the next."""
    with suppress(OSError):  # it is a pipe, or somebody else was quicker
        if Path(name).is_file():
            Path(name).unlink()


async def _record(line: Line) -> int:
    name = line.text("FILE")
    tapes: list[Tape] = []
    async with lasting(line) as here, securing(line) as security:

        def accept(link: Link) -> Tape:
            tapes.append(Tape(link, here, security))
            return tapes[-1]

        link = await connect(line.text("--connect"), accept)
        file = _created(name)  # only now: a link that cannot be had leaves no file behind
        try:
            began, recorder = time.monotonic(), Recorder(writer_of(name)(file))
            tapes[0].begin(recorder)
            note(f"recording {link.address}; Ctrl-C ends it")
            while not here.over:
                tapes[0].speak()
                recorder.flush()
                file.flush()
                await here.wait(PERIOD)
            link.close()
            code = here.exit_code()
            recorder.close()
            file.close()
        except OSError as error:
            link.close()  # before the file: what comes now is not written any more
            raise BadRecording(name, f"cannot be written: {error.strerror}; {_kept(file)}") from error
        finally:
            with suppress(OSError):  # what could not be written was told already
                file.close()
    if not recorder.frames:
        _drop(name)
    tell(line, recorder, time.monotonic() - began)
    return code or _worth(line, recorder, tapes[0].rejection)


def tell(line: Line, recorder: Recorder, seconds: float) -> None:
    """Say how much it was."""
    if line.flag("--json"):
        counts = {"frames": recorder.frames, "skipped": recorder.skipped, "withheld": recorder.withheld}
        put(json.dumps({"file": line.text("FILE"), **counts, "seconds": round(seconds, 3)}))
    else:
        skipped = f"; {recorder.skipped} bytes were no frame" if recorder.skipped else ""
        withheld = f"; {recorder.withheld} with keys were left out" if recorder.withheld else ""
        put(f"{line.text('FILE')}: {recorder.frames} frames in {seconds:.1f} s{skipped}{withheld}")


def _worth(line: Line, recorder: Recorder, doubt: str) -> int:
    """Whether anything was recorded; complain if not."""
    if doubt:
        note(f"{line.text('--connect')}: {doubt}")
    if recorder.frames:
        return exit_codes.DONE
    complain(f"no frame that could be recorded came from {line.text('--connect')}")
    return exit_codes.NOBODY
