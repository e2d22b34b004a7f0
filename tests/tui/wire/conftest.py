"""A simulated arm that listens on this machine, and the command line in this process."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from robotree.protocol.links.keyring import create
from robotree.tui.cli import main
from tests.command_line import ROBOTREE


@contextmanager
def simulated(*words: str) -> Generator[str]:
    """The address of an arm, simulated in a process of its own.

    It computes as long as it lives, so it ends with the tests of one file.
    """
    command = [*ROBOTREE, "sim", "arm", "--listen", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[1]
        process.terminate()


@pytest.fixture(scope="module")
def arm() -> Generator[str]:
    """An arm that hears everybody."""
    with simulated("tcp:127.0.0.1:0") as address:
        yield address


class Guarded(NamedTuple):
    """An arm behind datagrams that hears only who has its key."""

    address: str
    key: Path
    wrong: Path


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Generator[Guarded]:
    """Such an arm, its key, and another one."""
    folder = tmp_path_factory.mktemp("keys")
    for name in ("right.key", "wrong.key"):
        create(folder / name)
    with simulated("udp:127.0.0.1:0", "--key", str(folder / "right.key")) as address:
        yield Guarded(address, folder / "right.key", folder / "wrong.key")


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
