from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from robotree.vr.host.memory import MemoryNetwork
from robotree.vr.host.zenoh import ZenohTransport, join
from robotree.vr.transport import Transport


@pytest.fixture
async def join_zenoh(tmp_path: Path) -> AsyncIterator[Callable[[], Awaitable[ZenohTransport]]]:
    """Enter a realm of this test alone; whoever is still in it at the end is closed."""
    members: list[ZenohTransport] = []

    async def enter() -> ZenohTransport:
        members.append(await join("test", root=tmp_path / "realms"))
        return members[-1]

    yield enter
    for member in members:
        await member.close()


@pytest.fixture
async def join_memory() -> Callable[[], Awaitable[Transport]]:
    network = MemoryNetwork()

    async def enter() -> Transport:
        return network.join()

    return enter
