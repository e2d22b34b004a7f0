"""`robotree wire record --connect URL FILE`: keep every frame that a link brings.

`robotree wire decode FILE|-`: print the frames in any recording, and what was wrong with the rest.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, cast

import msgspec

from robotree.protocol.dialect.extension import extend
from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link
from robotree.protocol.links.rejection import rejection
from robotree.protocol.links.security import LinkSecurity
from robotree.protocol.links.url import connect
from robotree.protocol.services.heartbeat import PERIOD
from robotree.protocol.tools.capture.decode import Decoded, DecoderStatistics
from robotree.protocol.tools.capture.files import Recording
from robotree.protocol.tools.capture.recorder import Recorder, writer_of
from robotree.protocol.tools.capture.records import MOST_SHOWN, BadRecording, NoFrame
from robotree.tui import exit_codes
from robotree.tui.line.grammar import Line
from robotree.tui.seen.wording import columns
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


# -- `robotree wire decode` ------------------------------------------------------------------------


def decode(line: Line, _realm: str) -> int:
    """Print every frame, then how many of each message, and last what was wrong."""
    as_json = line.flag("--json")
    if line.text("--xml"):
        extend(Path(line.text("--xml")))
    file = Recording(line.text("FILE"), line.text("--as"))
    write = to_json if as_json else to_text
    for batch in file.frames():
        if lines := [write(one) for one in batch]:
            put("\n".join(lines))
    statistics = file.statistics
    put(msgspec.json.encode({"statistics": statistics}).decode() if as_json else summary(statistics))
    if not statistics.frames:
        raise NoFrame(file.name, statistics.strange)
    return exit_codes.DONE


def to_json(one: Decoded) -> str:
    """One frame as an object; NaN and infinity are null, since JSON has neither."""
    return msgspec.json.encode(one.plain()).decode()


def to_text(one: Decoded) -> str:
    """One frame as a line for people."""
    data = one.plain()
    when = "" if one.time is None else f"{datetime.fromtimestamp(one.time / 1e6, UTC):%H:%M:%S.%f} "
    route = f"{one.route} " if one.route else ""
    mark = " signed" if data["signed"] else ""
    speaker = f"{data['sysid']}/{data['compid']} #{data['seq']}"
    return f"{when}{route}{speaker} {data['name']}{mark} {fields(data['fields'])}"


def fields(values: dict[str, Any]) -> str:
    """Fields for people."""
    return " ".join(f"{name}={value_text(value)}" for name, value in values.items())


def value_text(value: Any) -> str:
    """One value for people."""
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else str(value)
    if isinstance(value, list | tuple):
        return f"[{' '.join(map(value_text, cast('Sequence[Any]', value)))}]"
    return repr(value) if isinstance(value, str) else str(value)


def summary(statistics: DecoderStatistics) -> str:
    """Statistics for people."""
    s = statistics
    span = 0.0 if s.first is None or s.last is None else s.last - s.first
    rows = [(str(count), _rate(count, span), name) for name, count in s.messages.items()]
    seconds = "" if s.first is None else f" in {span:.3f} s"
    head = (
        f"{s.frames} frames{seconds} from {s.bytes} bytes ({s.format}), "
        f"{s.signed} signed; lost {s.lost}, late {s.late}"
    )
    strange = f" ({', '.join(map(str, [*s.strange][:MOST_SHOWN]))})" if s.strange else ""
    wrong = (
        f"bad checksum {s.bad_crc}, unknown id {s.unknown}{strange}, incompatible {s.incompatible}, "
        f"refused {s.refused}, MAVLink 1 {s.version_1}, skipped {s.skipped} bytes"
    )
    damage = [(s.bad_times, "frames with a damaged time"), (s.broken, "frames in parts that cannot be read")]
    wrong += "".join(f", {count} {what}" for count, what in damage if count)
    can = ""
    if s.can is not None:
        c = s.can
        can = (
            f"\nCAN: {c.lines} lines, {c.malformed} malformed, {c.foreign} foreign, "
            f"{c.payloads} payloads, {c.broken} broken"
        )
    return "\n".join([*([columns(rows)] if rows else []), head, f"{wrong}{can}"])


def _rate(count: int, span: float) -> str:
    """How often something came within `span` [s]; nothing where no time passed."""
    return f"{count / span:.1f}/s" if span > 0 else ""
