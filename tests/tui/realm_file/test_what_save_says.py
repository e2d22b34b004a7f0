"""`save` says what a file of a realm cannot bring about again."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.line import manual
from robotree.tui.processes.programs import Program
from robotree.tui.realm_file import saving
from robotree.tui.realm_file.present import Present, Process
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription


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


def test_a_host_whose_robots_another_one_has_is_in_the_file_and_has_them_there(tmp_path: Path) -> None:
    words = ("host", "h2", "--standby-for", "h1", "--journal", "postgresql://db/robots")
    process = Process(manual.shell().parse(words), Program(1, words, tmp_path, ""))
    robot = RobotDescription(
        address=Address("robot", "one", "1"), kinds=("Robot",), host="h2", page=str(tmp_path / "a.py")
    )
    there = Present(realm="r", processes={process.id: process}, robots={"one": robot}, instead={"h2": "h1"})
    file, notes = saving.saved(there, tmp_path / "cell.yaml")
    assert "h1 does not run; it is in the file, for h2 has its robots" in notes
    hosts = {one.name: {key: word.text for key, word in one.facets.items()} for one in file.processes}
    assert hosts == {
        "h1": {"journal": "postgresql://db/robots"},
        "h2": {"standby-for": "h1", "journal": "postgresql://db/robots"},
    }
    (entry,) = file.robots
    assert entry.host is not None
    assert entry.host.text == "h1"
