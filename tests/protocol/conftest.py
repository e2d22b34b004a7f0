"""The reference: pymavlink's own generator, run on our dialect."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import pytest

from bench.wire import codec

if TYPE_CHECKING:
    from robotree.protocol.testing import Reference


@pytest.fixture(scope="session")
def oracle() -> ModuleType:
    """The module that mavgen makes of robotree.xml."""
    return codec.generate()


@pytest.fixture(scope="session")
def reference(oracle: ModuleType) -> Reference:
    """An encoder made of mavgen's output."""
    return codec.encoder(oracle)
