"""An event that code in virtual time can wait for, as `threading.Event` is in real time; calls may, too."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotree.vr.base.arguments import check_arguments
from robotree.vr.running import robot_runtime
from robotree.vr.running.runner import Waiter
from robotree.vr.world.virtual_loop import VirtualLoop


class Gate:
    """Open or not; made on the loop of a test in virtual time."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        self._runner = loop.runner
        self._open = False
        self._waiting: list[Waiter] = []

    def set(self) -> None:
        self._open = True
        for waiter in self._waiting:
            waiter.wake()

    def clear(self) -> None:
        self._open = False

    def wait(self) -> None:
        waiter = self._runner.waiter()
        self._waiting.append(waiter)
        while not self._open:
            waiter.wait(None)


def held_back(monkeypatch: pytest.MonkeyPatch) -> Gate:
    """Hold back every call with a text among its arguments that comes from now on, until the gate is set."""
    gate = Gate()

    def slow(*args: Any, **options: Any) -> dict[str, Any]:
        gate.wait()
        return check_arguments(*args, **options)

    monkeypatch.setattr(robot_runtime, "check_arguments", slow)
    return gate
