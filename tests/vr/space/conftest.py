"""Stores for tests; PostgreSQL is started once."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from robotree.vr.world.examine_space import OpenStore
from tests.vr.scripts.conftest import names_are_sure_at_once
from tests.vr.space import stores
from tests.vr.space.postgres import Server, server

__all__ = ["names_are_sure_at_once", "open_store", "postgres"]


@pytest.fixture(scope="session")
def postgres() -> Iterator[Server]:
    """A server whose files need not survive anything."""
    with server("fsync=off", "full_page_writes=off", "autovacuum=off") as running:
        yield running


@pytest.fixture(params=stores.KINDS)
def open_store(request: pytest.FixtureRequest, tmp_path: Path) -> OpenStore:
    """Opens new stores, of each kind in turn."""
    numbers = count()
    if request.param == "memory":
        return stores.memory
    if request.param == "sqlite":
        return lambda: stores.sqlite(tmp_path / f"{next(numbers)}.db")
    running: Server = request.getfixturevalue("postgres")
    return lambda: stores.postgres(running)
