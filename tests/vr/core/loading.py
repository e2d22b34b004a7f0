"""Calls whose arguments take their time before the command may begin, as units that are loaded do."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from robotree.vr.agents import commands
from robotree.vr.arguments import check_arguments


def held_back(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Hold back every call that comes from now on, until the event that is returned is set."""
    go_on = threading.Event()

    def slow(*args: Any, **options: Any) -> dict[str, Any]:
        go_on.wait()
        return check_arguments(*args, **options)

    monkeypatch.setattr(commands, "check_arguments", slow)
    return go_on
