"""The reference: pymavlink's own generator, run on our dialect."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType
from typing import TYPE_CHECKING

import pytest

from robotree.protocol.dialect import compile as compiler

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.protocol.codec import Value
    from robotree.protocol.dialect import Definition


@pytest.fixture(scope="session")
def oracle(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The module that mavgen makes of robotree.xml."""
    path = tmp_path_factory.mktemp("oracle") / "robotree_oracle.py"
    compiler.generate(path)
    spec = importlib.util.spec_from_file_location("robotree_oracle", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def reference(oracle: ModuleType) -> Callable[[Definition, dict[str, Value], int, int, int], bytes]:
    """An encoder made of mavgen's output."""

    def encode(
        definition: Definition, values: dict[str, Value], sequence: int, system: int, component: int
    ) -> bytes:
        theirs = {name: _as_mavgen_wants(value) for name, value in values.items()}
        message = oracle.mavlink_map[definition.id](**theirs)
        speaker = oracle.MAVLink(None, srcSystem=system, srcComponent=component)
        speaker.seq = sequence
        return bytes(message.pack(speaker))

    return encode


def _as_mavgen_wants(value: Value) -> object:
    if isinstance(value, str):
        return value.encode()
    return list(value) if isinstance(value, tuple | bytes) else value
