"""Our codec beside what pymavlink's generator makes of our dialect: the time per message of both, in turns.

"frames" are verified and can be told apart by id, sender and sequence, which is all that a recorder wants;
"messages" adds the typed message of every frame. pymavlink has no stage between the two.
"""

from __future__ import annotations

import importlib.util
import statistics
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from robotree.protocol import Parser, encode
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.messages import Heartbeat, Joints, Message, Tool
from robotree.protocol.messages.base import wire
from robotree.protocol.signing import EPOCH, UNITS, Key, Signer, SigningTime, StreamTable, Verifier

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from robotree.protocol import Frame
    from robotree.protocol.codec import Value
    from robotree.protocol.dialect import Definition
    from robotree.protocol.messages import AnyMessage
    from robotree.protocol.testing import Reference

BATCH = 100
"""Messages of one turn."""


@cache
def telemetry_40() -> Message:
    """A telemetry message of 40 bytes without an array: a time and eight numbers."""

    @wire("WIND_COV")
    class Wind(Message, frozen=True, gc=False):
        """Wind with its covariance, as in common.xml."""

        time_usec: int
        wind_x: float
        wind_y: float
        wind_z: float
        var_horiz: float
        var_vert: float
        wind_alt: float
        horiz_accuracy: float
        vert_accuracy: float

    return Wind(1_700_000_000_000_000, 0.5, -0.25, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5)


def messages() -> list[Message]:
    """The messages that the codecs are compared with."""
    return [
        telemetry_40(),
        Joints(123_456, (0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7, -0.8), 8),
        Tool(123_456, 0.4, 0.1, 0.3, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3, (32767, 1, 2, 3), 1),
        Heartbeat(0, 0, 128, 7, 4),
    ]


class Contest(NamedTuple):
    """One thing that both sides do `BATCH` times."""

    name: str
    ours: Callable[[], object]
    theirs: Callable[[], object]


RESTLESS = 1.5
"""A side whose middle turn took so many times its best one was disturbed: its figures are unsure."""


class Outcome(NamedTuple):
    """Times per message, [us]: of the best turn, which is the one that nothing else disturbed."""

    ours: float
    theirs: float
    ours_typical: float
    """Of the middle turn."""
    theirs_typical: float
    """Of the middle turn."""

    @property
    def sure(self) -> bool:
        """Whether both sides mostly had the machine for themselves."""
        return self.ours_typical <= RESTLESS * self.ours and self.theirs_typical <= RESTLESS * self.theirs

    @property
    def ratio(self) -> float:
        """How many times faster we are."""
        return self.theirs / self.ours


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
        return Parser(_verifier() if signed else None).feed(stream)

    def messages_of_frames() -> list[AnyMessage]:
        return [frame.message for frame in frames()]

    def decode_theirs() -> None:
        speaker(mavgen, signed=signed).parse_buffer(stream)

    return [
        Contest(f"encode{kind}", encode_ours, encode_theirs),
        Contest(f"decode{kind} to frames", frames, decode_theirs),
        Contest(f"decode{kind} to messages", messages_of_frames, decode_theirs),
    ]


def _verifier() -> Verifier:
    return Verifier(Key(SECRET), SigningTime(time.time), StreamTable())


def compare(contest: Contest, rounds: int) -> Outcome:
    """Let both sides take turns."""
    ours: list[float] = []
    theirs: list[float] = []
    for _ in range(rounds):
        for side, times in ((contest.ours, ours), (contest.theirs, theirs)):
            begin = time.perf_counter()
            side()
            times.append((time.perf_counter() - begin) / BATCH * 1e6)
    return Outcome(min(ours), min(theirs), statistics.median(ours), statistics.median(theirs))


SECRET = bytes(range(32))
"""The key of the signed contests."""


def generate() -> ModuleType:
    """The module that mavgen makes of our dialect; its checksums are fastcrc's, as ours."""
    with tempfile.TemporaryDirectory(prefix="robotree-reference-") as folder:
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
    """Its speaker and reader."""
    mavlink = mavgen.MAVLink(None, srcSystem=1, srcComponent=1)
    mavlink.robust_parsing = True
    if signed:
        mavlink.signing.secret_key, mavlink.signing.sign_outgoing = SECRET, True
        mavlink.signing.timestamp = int((time.time() - EPOCH) * UNITS)
    return mavlink


def encoder(mavgen: ModuleType, mavlink: Any = None) -> Reference:
    """Its encoder, as `robotree.protocol.testing.check_codec` wants one; `mavlink`: who speaks."""
    mavlink = mavlink or mavgen.MAVLink(None)

    def encode(
        definition: Definition, values: dict[str, Value], sequence: int, system: int, component: int
    ) -> bytes:
        theirs = {name: _as_mavgen_wants(value) for name, value in values.items()}
        mavlink.srcSystem, mavlink.srcComponent, mavlink.seq = system, component, sequence
        return bytes(mavgen.mavlink_map[definition.id](**theirs).pack(mavlink))

    return encode


def _as_mavgen_wants(value: Value) -> object:
    if isinstance(value, str):
        return value.encode()
    return list(value) if isinstance(value, tuple | bytes) else value
