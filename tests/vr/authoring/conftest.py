"""What authors of pages do, in virtual time and in one process."""

from __future__ import annotations

from tests.vr.core.conftest import pytest_asyncio_loop_factories, realm, units

__all__ = ["pytest_asyncio_loop_factories", "realm", "units"]
