"""The mutants of `bench/mutants.py`: off, they change nothing; on, each changes what its function does."""

from __future__ import annotations

from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

import robotree
from bench.mutants import Rewriter

SOURCE = '''"""A module."""
from __future__ import annotations
import contextlib

class Gauge:
    """Keeps the last readings."""

    def __init__(self, most=2):
        """Begin with none."""
        self.readings = []
        self.most = most

    def add(self, reading):
        if reading is None or reading < 0 or reading > 99:
            raise ValueError(f"{reading if reading else 'nothing'}")
        self.readings.append(reading)
        if len(self.readings) > self.most:
            del self.readings[0]
        match reading:
            case 7:
                self.most += 1
        return [one for one in self.readings if one != 5] if self.most < 4 else False
'''


def _plays(source: str) -> tuple[object, ...]:
    """Return what the module does with some readings."""
    space: dict[str, Any] = {}
    exec(source, space)  # noqa: S102 # the module above, and what the bench makes of it
    gauge, done = space["Gauge"](), list[object]()
    for reading in (3, 4, 5, 0, None, 7, -1, 99, 100, 6, *range(9)):
        try:
            done.append(gauge.add(reading))
        except Exception as error:  # noqa: BLE001 # whatever a mutant makes of it
            done.append(repr(error))
        with suppress(AttributeError):
            done.append((list(gauge.readings), gauge.most))
    return tuple(done)


def test_mutants_change_nothing_before_they_are_switched_on_and_then_each_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    switch = SimpleNamespace(on=0, entered=bytearray(9))
    monkeypatch.setattr(robotree, "mutants", switch, raising=False)
    rewriter = Rewriter()
    source = rewriter.rewrite(SOURCE, "gauge.py")
    assert _plays(source) == _plays(SOURCE)
    assert switch.entered[:3] == b"\x01\x01\x00"
    idle = []
    for number, mutant in enumerate(rewriter.mutants, 1):
        switch.on = number
        if _plays(source) == _plays(SOURCE):
            idle.append((mutant.kind, mutant.text))
    assert len(rewriter.mutants) == 21
    assert not idle
