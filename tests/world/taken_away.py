"""A plugin of pytest: the tests run without one safeguard, which the environment names (`VARIABLE`)."""

from __future__ import annotations

import os
from collections.abc import Generator

import pytest

from tests.world.safeguards import without

VARIABLE = "WITHOUT_SAFEGUARD"


@pytest.fixture(autouse=True)
def _without_a_safeguard() -> Generator[None]:
    with without(os.environ[VARIABLE]):
        yield
