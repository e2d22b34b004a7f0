"""Write frames.jsonl anew: frames as pymavlink's generated code writes them, one JSON object per line.

    python -m tests.protocol.golden.generate

Run it when a message of robotree.xml is added or changed. The file is checked in so that a change of bytes is
seen in a diff, whatever changed them: our codec, the dialect, or the generator itself.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from bench.wire.codec import SECRET, encoder, generate
from robotree.protocol.dialect.table import Definition, definitions
from robotree.protocol.testing import random_values

FILE = Path(__file__).with_name("frames.jsonl")
OURS = range(57600, 57700)
"""Ids of the dialect's own messages."""
BORROWED = ("HEARTBEAT", "PING", "TIMESYNC", "STATUSTEXT", "COMMAND_LONG", "COMMAND_ACK", "PARAM_VALUE")
SIGNED = ("HEARTBEAT", "ROBOTREE_GOAL", "ROBOTREE_JOINTS")
LINK_ID = 7
TIMESTAMP = 37_500_000_000_000
"""In units of 10 us since 2015: in November 2026."""


def lines(reference: ModuleType) -> Iterator[str]:
    """The lines of the file."""
    chance = random.Random(57600)
    by_name = {definition.name: definition for definition in definitions().values()}
    wanted = [*(by_name[name] for name in BORROWED), *(each for each in by_name.values() if each.id in OURS)]
    for definition in wanted:
        yield _line(reference, definition, chance, signed=False)
    for name in SIGNED:
        yield _line(reference, by_name[name], chance, signed=True)


def _line(reference: ModuleType, definition: Definition, chance: random.Random, *, signed: bool) -> str:
    values = random_values(definition, chance)
    speaker = reference.MAVLink(None)
    if signed:
        speaker.signing.secret_key, speaker.signing.sign_outgoing = bytearray(SECRET), True
        speaker.signing.link_id, speaker.signing.timestamp = LINK_ID, TIMESTAMP
    frame = encoder(reference, speaker)(definition, values, definition.id % 256, 1, 190)
    plain = {name: list(value) if isinstance(value, bytes) else value for name, value in values.items()}
    return json.dumps({"name": definition.name, "signed": signed, "hex": frame.hex(), "fields": plain})


if __name__ == "__main__":
    FILE.write_text("".join(f"{line}\n" for line in lines(generate())))
