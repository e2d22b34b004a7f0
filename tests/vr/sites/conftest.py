"""The sites of `site.py`, in virtual time."""

from __future__ import annotations

from tests.vr.core.conftest import pytest_asyncio_loop_factories
from tests.vr.sites.site import hub, sites

__all__ = ["hub", "pytest_asyncio_loop_factories", "sites"]
