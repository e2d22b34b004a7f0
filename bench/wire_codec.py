"""Our codec beside pymavlink's, interleaved in one run: medians of the time per message, and their ratios.

    python bench/wire_codec.py [--rounds N] [--json]

Both sides use fastcrc. Four telemetry messages: one of 40 bytes without an array, and our own joints, tool
and heartbeat. "frames" are verified and can be told apart by id, sender and sequence; "messages" adds the
typed message of every frame. pymavlink has no stage between the two.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from robotree.protocol import Parser, encode
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.messages import Heartbeat, Joints, Message, Tool
from robotree.protocol.messages.base import wire
from robotree.protocol.signing import Key, Signer, SigningTime, StreamTable, Verifier

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from robotree.protocol import Frame
    from robotree.protocol.messages import AnyMessage

BATCH = 100
SECRET = bytes(range(32))


@wire("WIND_COV")
class Telemetry40(Message, frozen=True, gc=False):
    """A telemetry message of 40 bytes: a time and eight numbers."""

    time_usec: int
    wind_x: float
    wind_y: float
    wind_z: float
    var_horiz: float
    var_vert: float
    wind_alt: float
    horiz_accuracy: float
    vert_accuracy: float


MESSAGES: list[Message] = [
    Telemetry40(1_700_000_000_000_000, 0.5, -0.25, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5),
    Joints(123_456, (0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7, -0.8), 8),
    Tool(123_456, 0.4, 0.1, 0.3, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3, (32767, 1, 2, 3), 1),
    Heartbeat(0, 0, 128, 7, 4),
]


class Contest(NamedTuple):
    """One thing that both sides do `BATCH` times."""

    name: str
    ours: Callable[[], object]
    theirs: Callable[[], object]


def reference() -> ModuleType:
    """What mavgen makes of our dialect."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robotree_reference.py"
        compiler.generate(path)
        spec = importlib.util.spec_from_file_location("robotree_reference", path)
        if spec is None or spec.loader is None:
            raise ImportError(path.name)
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
        return module


def speaker(mavgen: ModuleType, *, signed: bool) -> Any:
    """The reference's speaker and reader."""
    mavlink = mavgen.MAVLink(None, srcSystem=1, srcComponent=1)
    mavlink.robust_parsing = True
    if signed:
        mavlink.signing.secret_key, mavlink.signing.sign_outgoing = SECRET, True
        mavlink.signing.timestamp = int((time.time() - 1_420_070_400) * 100_000)
    return mavlink


def verifier() -> Verifier:
    """A fresh one."""
    return Verifier(Key(SECRET), SigningTime(time.time), StreamTable())


def contests(message: Message, mavgen: ModuleType, *, signed: bool) -> list[Contest]:
    """Everything both sides can do with one message."""
    definition = message.codec.definition
    values = [getattr(message, field.name) for field in definition.fields]
    theirs, mavlink = mavgen.mavlink_map[definition.id](*values), speaker(mavgen, signed=signed)
    signer = Signer(Key(SECRET), SigningTime(time.time)) if signed else None
    pieces = [encode(message, sequence=i, system=1, component=1, signer=signer) for i in range(BATCH)]
    stream, kind = b"".join(pieces), " signed" if signed else ""

    def encode_ours() -> None:
        for i in range(BATCH):
            encode(message, sequence=i, system=1, component=1, signer=signer)

    def encode_theirs() -> None:
        for i in range(BATCH):
            mavlink.seq = i
            theirs.pack(mavlink)

    def frames() -> list[Frame]:
        return Parser(verifier() if signed else None).feed(stream)

    def messages() -> list[AnyMessage]:
        return [frame.message for frame in frames()]

    def decode_theirs() -> None:
        speaker(mavgen, signed=signed).parse_buffer(stream)

    return [
        Contest(f"encode{kind}", encode_ours, encode_theirs),
        Contest(f"decode{kind} to frames", frames, decode_theirs),
        Contest(f"decode{kind} to messages", messages, decode_theirs),
    ]


def measure(contest: Contest, rounds: int) -> tuple[float, float]:
    """Median times per message of both sides, [us], measured in turns."""
    ours: list[float] = []
    theirs: list[float] = []
    for _ in range(rounds):
        for side, times in ((contest.ours, ours), (contest.theirs, theirs)):
            begin = time.perf_counter()
            side()
            times.append((time.perf_counter() - begin) / BATCH * 1e6)
    return statistics.median(ours), statistics.median(theirs)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    mavgen, rows = reference(), []
    for message in MESSAGES:
        name, size = message.codec.definition.name, message.codec.definition.length
        for contest in contests(message, mavgen, signed=False) + contests(message, mavgen, signed=True):
            ours, theirs = measure(contest, arguments.rounds)
            row = {"message": name, "bytes": size, "task": contest.name, "ours_us": round(ours, 3)}
            rows.append(row | {"pymavlink_us": round(theirs, 3), "ratio": round(theirs / ours, 2)})
    if arguments.json:
        print(json.dumps(rows))
        return
    print(f"{'message':18}{'bytes':>6}  {'task':28}{'ours us':>9}{'pymavlink us':>14}{'ratio':>7}")
    for row in rows:
        print("{message:18}{bytes:6}  {task:28}{ours_us:9.2f}{pymavlink_us:14.2f}{ratio:7.1f}".format(**row))


if __name__ == "__main__":
    main()
