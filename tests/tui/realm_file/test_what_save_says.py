"""`save` says what a file of a realm cannot bring about again."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.line import manual
from robotree.tui.processes.programs import Program
from robotree.tui.realm_file import saving
from robotree.tui.realm_file.present import Present, Process


@pytest.mark.parametrize(
    ("address", "by_chance"),
    [
        ("tcp:127.0.0.1:40000", True),
        ("tcp:localhost:59999", True),
        ("tcp:[::1]:32768", True),
        ("tcp:127.0.0.1:5760", False),
        ("tcp:192.168.1.20:40000", False),
        ("serial:/dev/ttyUSB0?baud=40000", False),
    ],
)
def test_a_port_that_was_free_by_chance_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str, *, by_chance: bool
) -> None:
    ports = tmp_path / "range"
    ports.write_text("32768\t60999\n")
    monkeypatch.setattr(saving, "_RANGE", ports)
    words = ("proxy", "arm", "arm-1", "--connect", address)
    process = Process(manual.shell().parse(words), Program(1, words, tmp_path, ""))
    _, notes = saving.saved(Present(realm="r", processes={process.id: process}), tmp_path / "cell.yaml")
    assert [f"arm-1 connects to {address}, a port that was free by chance" in note for note in notes] == (
        [True] if by_chance else []
    )
