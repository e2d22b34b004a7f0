"""Both transports pass one examination."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest

from robotree.vr.testing import TRANSPORT_CHECKS, Join

Check = Callable[[Join], Awaitable[None]]


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_memory(check: Check, join_memory: Join) -> None:
    await check(join_memory)


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_zenoh(check: Check, join_zenoh: Join) -> None:
    await check(join_zenoh)
