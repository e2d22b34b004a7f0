"""`robotree wire decode FILE|-`: the frames in any recording, and what was wrong with the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import msgspec

from robotree.protocol.dialect.extension import extend
from robotree.protocol.tools.capture.decode import Decoded, DecoderStatistics
from robotree.protocol.tools.capture.files import Recording
from robotree.protocol.tools.capture.records import MOST_SHOWN, NoFrame
from robotree.tui import exit_codes
from robotree.tui.line.grammar import Line
from robotree.tui.seen.wording import columns
from robotree.tui.terminal import put


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
