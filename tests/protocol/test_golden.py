"""Frames that were written down once, by the reference generator: read, written and signed the same."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.dialect import by_name, definitions
from robotree.protocol.messages import fields_of
from robotree.protocol.messages.base import codec_of
from robotree.protocol.signing import EPOCH, UNITS, Key, Signer, SigningTime, StreamTable, Verifier

GOLDEN = Path(__file__).with_name("golden")
FRAMES: list[dict[str, Any]] = [
    json.loads(line) for line in (GOLDEN / "frames.jsonl").read_text().splitlines()
]


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    """The script that wrote the frames down."""
    spec = importlib.util.spec_from_file_location("golden_generate", GOLDEN / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _time(generate: ModuleType) -> SigningTime:
    moment = EPOCH + generate.TIMESTAMP / UNITS
    return SigningTime(lambda: moment - 1, persisted=generate.TIMESTAMP - 1)


def _plain(message: Any) -> dict[str, Any]:
    fields = fields_of(message).items()
    return {name: list(value) if isinstance(value, tuple | bytes) else value for name, value in fields}


@pytest.mark.parametrize(
    "golden", FRAMES, ids=[f"{one['name']}{' signed' * one['signed']}" for one in FRAMES]
)
def test_a_golden_frame_is_read_and_written_the_same(golden: dict[str, Any], generate: ModuleType) -> None:
    raw, key = bytes.fromhex(golden["hex"]), Key(generate.SECRET)
    verifier = Verifier(key, _time(generate), StreamTable()) if golden["signed"] else None
    (frame,) = Parser(verifier).feed(raw)
    assert frame.signed is golden["signed"]
    assert (frame.system, frame.component) == (1, 190)
    assert _plain(frame.message) == golden["fields"]

    definition = by_name()[golden["name"]]
    fields = {field.name: field for field in definition.fields}
    values = [
        value if not isinstance(value, list) else bytes(value) if fields[name].is_bytes else tuple(value)
        for name, value in golden["fields"].items()
    ]
    message = codec_of(definition.id).build(*values)
    signer = Signer(key, _time(generate), generate.LINK_ID) if golden["signed"] else None
    again = encode(message, sequence=definition.id % 256, system=1, component=190, signer=signer)
    assert again.hex() == golden["hex"]


def test_the_file_is_what_the_reference_writes_today(generate: ModuleType, oracle: ModuleType) -> None:
    advice = "run `python tests/protocol/golden/generate.py` and look at the diff"
    assert (GOLDEN / "frames.jsonl").read_text().splitlines() == [*generate.lines(oracle)], advice


def test_every_message_of_ours_is_in_the_file(generate: ModuleType) -> None:
    ours = {each.name for each in definitions().values() if each.id in generate.OURS}
    assert ours
    assert ours <= {frame["name"] for frame in FRAMES}
