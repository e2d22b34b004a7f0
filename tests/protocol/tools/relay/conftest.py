"""A CAN channel that nobody else uses."""

from __future__ import annotations

import uuid

import pytest


@pytest.fixture
def unused_channel() -> str:
    return f"relay-{uuid.uuid4().hex[:12]}"
