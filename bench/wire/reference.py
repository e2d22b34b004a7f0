"""The other side of the codec's contests: what pymavlink's generator makes of our dialect."""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.protocol.dialect import compile as compiler
from robotree.protocol.signing import EPOCH, UNITS

if TYPE_CHECKING:
    from types import ModuleType

    from robotree.protocol.codec import Value
    from robotree.protocol.dialect import Definition
    from robotree.protocol.testing import Reference

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


def encoder(mavgen: ModuleType) -> Reference:
    """Its encoder, as `robotree.protocol.testing.check_codec` wants one."""

    def encode(
        definition: Definition, values: dict[str, Value], sequence: int, system: int, component: int
    ) -> bytes:
        theirs = {name: _as_mavgen_wants(value) for name, value in values.items()}
        mavlink = mavgen.MAVLink(None, srcSystem=system, srcComponent=component)
        mavlink.seq = sequence
        return bytes(mavgen.mavlink_map[definition.id](**theirs).pack(mavlink))

    return encode


def _as_mavgen_wants(value: Value) -> object:
    if isinstance(value, str):
        return value.encode()
    return list(value) if isinstance(value, tuple | bytes) else value
