"""Calls whose arguments take their time before the command may begin, as units that are loaded do."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.vr.base.arguments import check_arguments
from robotree.vr.running import robot_runtime
from tests.vr.core.gate import Gate


def held_back(monkeypatch: pytest.MonkeyPatch) -> Gate:
    """Hold back every call with a text among its arguments that comes from now on, until the gate is set."""
    gate = Gate()

    def slow(*args: Any, **options: Any) -> dict[str, Any]:
        gate.wait()
        return check_arguments(*args, **options)

    monkeypatch.setattr(robot_runtime, "check_arguments", slow)
    return gate
