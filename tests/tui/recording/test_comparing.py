"""Two recordings beside each other, and recordings that are read while they are written."""

from __future__ import annotations

import fcntl
import io
import json
from pathlib import Path

import pytest

from robotree.tui.cli import main
from robotree.tui.exit_codes import USAGE
from robotree.tui.recording import comparing, tape
from robotree.tui.recording.comparing import Beside
from robotree.tui.recording.replaying import Player
from robotree.tui.recording.tape import TapeWriter
from robotree.tui.screen.driver import LEAVE, OutlivingDriver
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.requests import LoggedLine, State

NOON = 1_800_000_000.0
ARM = RobotDescription(address=Address("robot", "arm-1", "1"), kinds=("Arm",), units={"z": "m"})

Command = tuple[str, float, float, str, float]
"""Words, when it began and ended [s], how, and the height [m] then."""


def written(*commands: Command, closed: bool = True) -> bytes:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {"realm": "hall", "began": repr(NOON)})
    writer.description(NOON, ARM)
    writer.state(NOON, "arm-1", State(readings={"z": 0.0}))
    for number, (words, began, ended, how, height) in enumerate(commands):
        name, _, arguments = words.partition(" ")
        asked = LoggedLine(
            2 * number, NOON + began, "asked", "", command=name, key=str(number), arguments=arguments
        )
        writer.line("arm-1", asked)
        writer.state(NOON + ended - 0.01, "arm-1", State(readings={"z": height}))
        writer.line("arm-1", LoggedLine(2 * number + 1, NOON + ended, how, "", command=name, key=str(number)))  # type: ignore[arg-type]
    writer.flush()
    if closed:
        writer.close()
    return stream.getvalue()


def tape_of(*commands: Command, name: str = "a.mcap") -> tape.Tape:
    return tape.read(io.BytesIO(written(*commands)), name)


MONDAY: tuple[Command, ...] = (
    ("go_to z=0.3", 1, 3, "done", 0.3),
    ("grip", 4, 5, "done", 0.3),
    ("go_to z=1", 6, 8, "done", 1.0),
)


def test_a_recording_differs_in_nothing_from_itself() -> None:
    pairs = comparing.compared(tape_of(*MONDAY), tape_of(*MONDAY))
    assert [pair.differs for pair in pairs] == [(), (), ()]


def test_what_was_otherwise_is_said_of_each_command() -> None:
    tuesday = (
        ("go_to z=0.3", 1, 3.02, "done", 0.301),
        ("hold", 3.5, 3.6, "done", 0.3),
        ("grip", 4, 7, "failed", 0.3),
        ("go_to z=1", 8, 10, "done", 0.6),
    )
    first, second = tape_of(*MONDAY), tape_of(*tuesday, name="b.mcap")
    pairs = comparing.compared(first, second)
    assert [((pair.first or pair.second).words, pair.differs) for pair in pairs] == [  # type: ignore[union-attr]
        ("arm-1.go_to z=0.3", ()),
        ("arm-1.hold", ("only in the second",)),
        ("arm-1.grip", ("done → failed", "1.00 s → 3.00 s")),
        ("arm-1.go_to z=1", ("z 1 m → 0.6 m",)),
    ]
    assert "a.mcap → b.mcap: 4 commands, 3 differ; 8.0 s → 10.0 s" in comparing.text(first, second)
    assert comparing.data(first, second)["differ"] == 3


def test_the_replay_says_what_was_otherwise_in_the_other_one() -> None:
    second = tape_of(*MONDAY[:2], ("go_to z=1", 6, 8, "done", 0.5))
    player = Player(tape_of(*MONDAY), 1.0, second)
    player.open()
    assert "≠" not in player.words
    player.go_to(NOON + 3.5)
    assert player.words.endswith("  = arm-1.go_to z=0.3: as in the other")
    player.go_to(NOON + 9)
    assert player.words.endswith("  ≠ arm-1.go_to z=1: z 1 m → 0.5 m")
    assert Beside(tape_of(*MONDAY), second).words(0.5) == ""


def test_beside_each_other_two_recordings_show_what_goes_on_in_both_and_which_readings_differ() -> None:
    beside = Beside(tape_of(*MONDAY), tape_of(*MONDAY[:2], ("go_to z=1", 7, 9, "done", 0.5)))
    early, late, over = (beside.text(seconds) for seconds in (6.5, 7.5, 9.5))
    assert early.startswith("6.5 s after the beginning of both\n\nall readings are as in the other\n")
    assert "▸   ≠  arm-1.go_to z=1" in early
    assert "▸▸  ≠  arm-1.go_to z=1" in late
    moments = "9.5 s after the beginning of both; a.mcap is over after 8.0 s; a.mcap is over after 9.0 s"
    assert over.startswith(f"{moments}\n\narm-1.z  1 m → 0.5 m\n")
    assert "▸" not in over


def test_readings_that_a_person_reads_as_the_same_do_not_differ() -> None:
    """Their range is that of noise alone, of which two parts in a hundred are less than what is shown."""
    first, second = (tape_of(("hold", 1, 2, "done", height)) for height in (4e-13, 0.0))
    assert comparing.ranges(first, second)["arm-1", "z"] > 0.0
    assert Beside(first, second).words(3.0) == "= arm-1.hold: as in the other"
    assert "→" not in Beside(first, second).text(3.0)


def test_two_files_are_compared_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, commands in (("a", MONDAY), ("b", MONDAY[:1])):
        (tmp_path / f"{name}.mcap").write_bytes(written(*commands))
    words = ["recording", "compare", str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap")]
    assert main(words) == 0
    assert "only in the first" in capsys.readouterr().out
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["differ"] == 2
    (tmp_path / "b.mcap").write_bytes(b"no recording")
    assert main(words) == 1
    assert "is no recording of a realm" in capsys.readouterr().err


def test_a_recording_that_is_being_written_is_not_cut_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.mcap"
    file.write_bytes(written(*MONDAY, closed=False))
    with file.open("rb") as recorder:
        fcntl.flock(recorder, fcntl.LOCK_EX)
        assert main(["recording", str(file)]) == 0
        assert "; it is still being written" in capsys.readouterr().out
    assert main(["recording", str(file)]) == 0
    assert "; it was cut off, or its end is damaged" in capsys.readouterr().out


def test_a_moment_behind_the_end_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.mcap"
    file.write_bytes(written(*MONDAY))
    assert main(["recording", str(file), "--at", "8s"]) == 0
    assert "arm-1" in capsys.readouterr().out
    assert main(["recording", str(file), "--at", "9s"]) == USAGE
    assert "a.mcap is only 8.0 s long; write a shorter time" in capsys.readouterr().err


def test_a_screen_that_is_followed_by_another_does_not_show_the_shell(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sent = list[str]()
    driver = object.__new__(OutlivingDriver)
    monkeypatch.setattr("textual.drivers.linux_driver.LinuxDriver.write", lambda _, data: sent.append(data))
    driver.write(LEAVE)
    driver.stays = True
    driver.write(LEAVE)
    driver.write("x")
    assert sent == [LEAVE, "x"]
