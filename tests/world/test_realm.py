"""A whole realm in virtual time repeats exactly: in another process, and from encoded states."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.world.story import play

ROOT = Path(__file__).resolve().parents[2]
DIGEST = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from tests.world.story import play
print(play(1).digest)
"""


@pytest.fixture(scope="module")
def digest() -> str:
    return play(1).digest


def test_a_seed_gives_the_same_trace_in_another_process(tmp_path: Path, digest: str) -> None:
    """Whatever the order of sets of strings is there, and the folder in which it runs."""
    run = subprocess.run(
        [sys.executable, "-c", DIGEST],
        cwd=tmp_path,
        env={**os.environ, "PYTHONHASHSEED": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == digest


def test_robots_that_go_on_from_their_encoded_states_do_the_same(digest: str) -> None:
    """At two hundred moments every robot of the realm goes on from what is decoded from its encoding."""
    assert play(1, reloads=200).digest == digest
