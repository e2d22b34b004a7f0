"""A simulated arm that listens on this machine, and the command line in this process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.cli import main

ROBOTREE = [sys.executable, "-m", "robotree.tui"]


@pytest.fixture(scope="session")
def arm() -> Generator[str]:
    """The address of a simulated arm."""
    words = [*ROBOTREE, "sim", "arm", "--listen", "tcp:127.0.0.1:0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[1]
        process.terminate()


class Said:
    """What one command line said, and its exit code."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err
        self.lines = out.splitlines()

    @property
    def objects(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.lines]


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str]) -> Any:
    def obey(*words: str | Path) -> Said:
        code = main([str(word) for word in words])
        told = capsys.readouterr()
        return Said(code, told.out, told.err)

    return obey
