"""A ground station that signs as QGroundControl: with MAVLink's C library and the key of a passphrase."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.command_line import ROBOTREE
from tests.examples.controllers import COMPILER, Running, started

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="session")
def station(controller_c: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its program."""
    include = controller_c.parent / "include"
    program = tmp_path_factory.mktemp("station") / "station"
    source = Path(__file__).with_name("station.c")
    words = [
        COMPILER or "cc",
        "-std=c99",
        "-isystem",
        include,
        "-isystem",
        include / "robotree",
        source,
        "-o",
        program,
    ]
    subprocess.run(words, check=True)
    return program


def passphrase(key: Path, arm: Running) -> str:
    words = [*ROBOTREE, "wire", "key", str(key), "--of", arm.url]
    told = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    found = re.search(r"(?m)^passphrase +(\S+)", told)
    assert found
    return found[1]


def test_the_passphrase_of_one_controller_commands_it_and_no_other(station: Path, tmp_path: Path) -> None:
    key = tmp_path / "cell.key"
    subprocess.run([*ROBOTREE, "wire", "key", str(key)], check=True)
    words = [*ROBOTREE, "sim", "arm", "--listen", "tcp:127.0.0.1:0", "--key", str(key)]
    env = {"XDG_STATE_HOME": str(tmp_path)}
    with started(words, env) as one, started(words, env) as other:
        phrase = passphrase(key, one)

        def said(arm: Running) -> str:
            asked = [station, arm.url.rpartition(":")[2], phrase]
            return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()

        assert said(one) == "answered 0"
        assert said(other) == "silence"
