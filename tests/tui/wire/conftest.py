"""A simulated arm that listens on this machine, and the command line in this process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Generator

import pytest

ROBOTREE = [sys.executable, "-m", "robotree.tui"]


@pytest.fixture(scope="session")
def arm() -> Generator[str]:
    """The address of a simulated arm."""
    words = [*ROBOTREE, "sim", "arm", "--listen", "tcp:127.0.0.1:0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[1]
        process.terminate()
