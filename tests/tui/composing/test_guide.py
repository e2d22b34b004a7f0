"""docs/composing.md: its steps and its commands are carried out, and its keys are those of the screen."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pytest

from robotree.testing.team import unended
from robotree.tui.cli import main
from robotree.tui.composing.demonstration import NEAR, TOLERANCE
from robotree.tui.composing.writing import Prepared, Tried, tried
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.page_keys import page_keys
from robotree.tui.recording import composed
from tests.tui.composing.shown import CARRIED
from tests.tui.composing.tapes import recording

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
