"""The public names of the protocol, and what they promise."""

from __future__ import annotations

import doctest
import importlib
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from robotree import protocol

if TYPE_CHECKING:
    from pathlib import Path

TRIES = 8
BUDGET = 0.060
"""[s] of processor time, the best of a few tries; most of it is msgspec's own."""


def test_all_is_sorted_and_every_public_name_has_a_docstring() -> None:
    assert protocol.__all__ == sorted(protocol.__all__)
    for name in protocol.__all__:
        assert getattr(protocol, name).__doc__


def _run(code: str, **environment: str) -> str:
    command = [sys.executable, "-c", code]
    everything = os.environ | environment
    return subprocess.run(command, env=everything, check=True, capture_output=True, text=True).stdout


@pytest.mark.speed
def test_the_import_is_fast(tmp_path: Path) -> None:
    """With bytecode at hand, as in any second run."""
    code = "import time; a = time.process_time(); import robotree.protocol; print(time.process_time() - a)"
    kept = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(tmp_path)}
    assert min(float(_run(code, **kept)) for _ in range(TRIES)) < BUDGET


def test_opening_the_room_brings_in_no_generator_no_loop_and_no_other_room() -> None:
    code = "import sys, robotree.protocol, robotree.protocol.services.goal_server; print(*sys.modules)"
    modules = _run(code).split()
    unwanted = ("pymavlink", "numpy", "asyncio", "can", "mujoco", "lxml", "cryptography")
    assert not [name for name in modules if name.split(".")[0] in unwanted]
    rooms = {name.split(".")[1] for name in modules if name.startswith("robotree.")}
    assert rooms == {"protocol"}


@pytest.mark.parametrize("name", ["", ".links.url", ".services.version"])
def test_the_examples_in_the_manual_run(name: str) -> None:
    result = doctest.testmod(importlib.import_module(f"robotree.protocol{name}"))
    assert result.attempted
    assert not result.failed
