"""The verb `compose` and its guide: files out of steps, recordings and sessions; nothing is overwritten."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.testing.team import unended
from robotree.tui.cli import main
from robotree.tui.composing.demonstration import NEAR, TOLERANCE
from robotree.tui.composing.lines import read_lines
from robotree.tui.composing.writing import KnownRobots, Prepared, Tried, prepared, tried
from robotree.tui.exit_codes import REFUSED, USAGE
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.page_keys import page_keys
from robotree.tui.recording import composed
from robotree.tui.session.playing import Player
from robotree.tui.session.script import read
from tests.tui.composing.shown import CARRIED, STEPS, recording

if TYPE_CHECKING:
    from tui.conftest import Realm

PLACES = [f"{place}_{axis}" for place in ("from", "to") for axis in "xyz"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path


def test_a_recording_becomes_a_page_its_panel_its_test_and_its_steps(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "cup.mcap").write_bytes(recording(CARRIED))
    assert main(["compose", "cup", "--from", "cup.mcap", "--untried", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"] == ["cup.py", "cup.panel.yaml", "test_cup.py", "cup.steps"]
    assert told["lines"] <= 40
    assert told["parameters"] == dict(zip(PLACES, (0.3, -0.2, 0.03, 0.3, -0.3, 0.03), strict=True))
    assert (here / "cup.steps").read_text() == STEPS
    assert main(["check", "cup.py"]) == 0
    assert "no mistake was found" in capsys.readouterr().out


def test_a_hand_that_was_recorded_empty_expects_nothing(here: Path) -> None:
    for name, width, expects in (("air", 0.0, False), ("cup", 0.06, True)):
        (here / "shown.mcap").write_bytes(recording(CARRIED, width))
        assert main(["compose", name, "--from", "shown.mcap", "--untried"]) == 0
        assert ("nothing is there" in (here / f"{name}.steps").read_text()) is expects


def test_what_a_robot_did_for_another_one_is_composed_when_it_is_named(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "cup.mcap").write_bytes(recording(CARRIED, caller="greeter"))
    words = ["compose", "cup", "--from", "cup.mcap", "--untried"]
    assert main(words) != 0, "no person asked for anything"
    assert main([*words, "--of", "arm-9"]) != 0
    assert "arm-9 is not in cup.mcap; there is arm-1" in capsys.readouterr().err
    assert main([*words, "--of", "arm-1"]) == 0
    assert (here / "cup.steps").read_text() == STEPS


def test_what_was_written_is_replaced_only_when_that_is_asked_for(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "mine.steps").write_text(STEPS)
    (here / "test_cup.py").write_text("mine")
    words = ["compose", "cup", "--from", "mine.steps", "--untried"]
    assert main(words) != 0
    assert "test_cup.py is there already, and is yours" in capsys.readouterr().err
    assert main(words[:-1]) != 0
    said = capsys.readouterr().err
    assert "test_cup.py is there already, and is yours" in said
    assert "twin" not in said, "that is known before it is tried"
    assert sorted(path.name for path in here.iterdir() if path.is_file()) == ["mine.steps", "test_cup.py"]
    assert (here / "test_cup.py").read_text() == "mine"
    assert main([*words, "--force"]) == 0
    assert "def test_it_does_what_was_composed" in (here / "test_cup.py").read_text()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("no.mcap", None, "does not exist"),
        ("cut.mcap", b"\x89MCAP0\r\n", "recording"),
        ("other.mcap", b"nonsense" * 100, "recording"),
        ("no.steps", None, "no.steps"),
        ("empty.steps", b"", "`robot NAME`"),
        ("bytes.steps", b"\xff\xfe\x00", "it is not UTF-8 text"),
        ("large.steps", b"#" * 500_000, "larger than"),
        ("no.session", None, "no.session"),
        ("wrong.session", b"fly\n", "wrong.session, line 1"),
        ("far.session", b"call arm-9.hold\n", "line 1: arm-9 is not here"),
        ("idle.session", b"stop\n", "nothing was shown"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_sentence(
    here: Path, name: str, content: bytes | None, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if content is not None:
        (here / name).write_bytes(content)
    assert main(["compose", "cup", "--from", name, "--untried"]) in {1, REFUSED, USAGE}
    said = capsys.readouterr().err
    assert told in said
    assert "Traceback" not in said
    assert not (here / "cup.py").exists()


@pytest.mark.parametrize("words", [["os"], ["../x"], ["Cup Board"], ["cup", "--tolerance", "2kg"]])
def test_a_name_or_tolerance_that_cannot_be_meant_is_refused(here: Path, words: list[str]) -> None:
    (here / "cup.mcap").write_bytes(recording(CARRIED))
    assert main(["compose", *words, "--from", "cup.mcap", "--untried"]) != 0
    assert [path.name for path in here.iterdir() if path.is_file()] == ["cup.mcap"]


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        ("  arm.hold\n  arm.goto x=0.3", "wrong.steps, line 5: arm.goto: Arm has no such command"),
        ("  arm.hold\n\n  repeat 2\n    arm.goto", "wrong.steps, line 7: arm.goto: Arm has no such command"),
        ("  arm.hold\n  part a", "wrong.steps, line 5: there is no step in `part a`"),
        ("  wait 5", "wrong.steps: no step calls a robot"),
    ],
)
def test_a_step_that_cannot_be_meant_is_told_with_its_line(
    here: Path, steps: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "wrong.steps").write_text(f"robot cup\nslot arm Arm\ndo\n{steps}\n")
    assert main(["compose", "cup", "--from", "wrong.steps", "--untried"]) == REFUSED
    assert told in capsys.readouterr().err


async def test_a_session_line_composes_what_another_session_asks(realm: Realm, here: Path) -> None:
    (here / "wave.session").write_text("call arm-1.go_to x=0.3 y=0 z='20 cm' twist=0\ncall arm-1.hold\n")
    script = read("compose waving --from wave.session --untried\n", "it.session")
    report = await Player(realm.realm_client, script, lambda _: None).play()
    assert report.ok, [step.seen for step in report.told]
    assert "self.arm.go_to(x=0.3, y=0.0, z=0.2, twist=0.0)" in (here / "waving.py").read_text()


async def test_a_robot_of_a_page_is_described_beside_the_test(realm: Realm, here: Path) -> None:
    await realm.create("move_to.py", "mover")
    (here / "own.py").write_text(
        '"""Own."""\nfrom robotree.vr import VirtualRobot, command\n\n\nclass Own(VirtualRobot):\n'
        '    """Own."""\n\n    @command\n    def wave(self, times: int = 2) -> None:\n        """Wave."""\n'
    )
    await realm.realm_client.create(str(here / "own.py"), "own")
    (here / "wave.session").write_text("call own.wave times=3\n")
    line = Line("compose", {"NAME": "waving", "--from": "wave.session", "--untried": True})
    made = await carry_out(realm.realm_client, line, Silent())
    assert not isinstance(made, Refusal), str(made)
    assert "waving.own.json" in made.data["files"]
    assert 'Fake(HERE / "waving.own.json")' in (here / "test_waving.py").read_text()


async def test_without_a_file_the_verb_says_what_it_needs(realm: Realm) -> None:
    refused = await carry_out(realm.realm_client, Line("compose", {"NAME": "cup"}), Silent())
    assert isinstance(refused, Refusal)
    assert "FILE.mcap" in str(refused)


def test_the_twin_carries_a_cup_that_has_moved_and_misses_one_that_is_not_there() -> None:
    ready = prepared(read_lines(STEPS), KnownRobots.of(), "Shown.")
    again = tried(ready, {"from_y": -0.25}, {"arm": (0.3, -0.25)})
    assert again.ok, again.error
    assert again.thing == pytest.approx((0.3, -0.3, 0.02), abs=0.005)
    missed = tried(ready, {"from_y": -0.1}, {"arm": (0.3, -0.2)})
    assert not missed.ok
    assert "nothing is there (cup.py, line " in missed.told


def test_what_fails_in_the_twin_is_not_written(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "far.steps").write_text("robot far\nslot arm Arm\ndo\n  arm.go_to x=0.65 y=0.65 z=0.8 twist=0\n")
    assert main(["compose", "far", "--from", "far.steps"]) != 0
    said = capsys.readouterr().err
    assert "nothing was written: tried in a twin of the cell: it failed" in said
    assert "self.arm.go_to(x=0.65, y=0.65, z=0.8, twist=0.0))" in said, "the step is named"
    assert not (here / "far.py").exists()
    assert "far" not in sys.modules


@pytest.mark.parametrize("source", ["/dev/zero", "/dev/tty"])
def test_a_device_is_no_composition(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["compose", "tidy", "--from", source]) != 0
    assert not list(tmp_path.iterdir())


# -- docs/composing.md: its steps and its commands are carried out, and its keys are those of the screen

DOC = (Path(__file__).parents[3] / "docs" / "composing.md").read_text()
BLOCKS = re.findall(r"^```(\S*) ?(\S*)\n(.*?)^```$", DOC, re.MULTILINE | re.DOTALL)
ELSEWHERE = {"record", "demo"}
"""Verbs of the guide that test_recordings.py and test_demos.py of tests/scenarios carry out."""


def test_each_command_of_the_guide_is_carried_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.syspath_prepend(tmp_path)
    trials = list[Tried]()

    def tried_once(ready: Prepared) -> Tried:
        trials.append(trials[0] if trials else tried(ready))
        return trials[-1]

    monkeypatch.setattr(composed, "tried", tried_once)
    (tmp_path / "cup.mcap").write_bytes(recording(CARRIED))
    (tmp_path / "tour.session").write_text("call arm-1.hold\n")
    for language, name, body in BLOCKS:
        if language == "steps":
            (tmp_path / name).write_text(body)
    seen = set[str]()
    for line in "".join(body for language, _, body in BLOCKS if not language).splitlines():
        program, *words = shlex.split(re.split(r"\s{3,}", line)[0])
        if program == "pytest":
            names = runpy.run_path(words[0])
            tests = [names[name] for name in names if name.startswith("test_")]
            assert len(tests) == 2
            for test in tests:
                test()
                for team in unended():
                    team.close()
        elif words[0] not in ELSEWHERE:
            code = main(words)
            told = capsys.readouterr()
            if "tour" in words:  # nobody lives here: test_verb.py has it where robots are
                assert "arm-1 is not here" in told.err
            else:
                assert code == 0, told.err
        seen.add(words[0])
    assert seen == {"record", "compose", "check", "test_tidy.py"}
    assert len(trials) == 2, "all that is not --untried"


def test_the_keys_of_the_guide_are_those_of_the_screen() -> None:
    keys = {part for key in page_keys("compose") for part in (key.key, key.shown)}
    told = {BY_VERB["compose"].key, "O", "o", "enter"} | {key.key for key in page_keys("compose")}
    spelled = {"esc": "escape", "$": "dollar_sign"}
    for key in ("C", "T", "esc", "f5", "ctrl+r", "a", "enter", "ctrl+up", "ctrl+down", "delete", "$"):
        assert f"`{key}`" in DOC
        assert spelled.get(key, key) in told
    assert {"left", "right"} <= keys


def test_the_figures_of_the_guide_are_those_of_the_program() -> None:
    assert f"within {1000 * TOLERANCE:.0f} mm" in DOC
    assert f"within {100 * NEAR:.0f} cm" in DOC
