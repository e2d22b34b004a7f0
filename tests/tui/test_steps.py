"""The step of the tele-operation that was chosen last is so after a restart, and no file can harm it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.processes.steps import KEPT, Steps


def test_a_step_is_the_same_after_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "steps.json"
    steps = Steps(file)
    steps.choose("arm-1", 5)
    steps.choose("arm-2", 0)
    again = Steps(file)
    assert (again.get("arm-1", 3), again.get("arm-2", 3), again.get("arm-3", 3)) == (5, 0, 3)


def test_only_the_last_choices_are_kept(tmp_path: Path) -> None:
    steps = Steps(tmp_path / "steps.json")
    for number in range(KEPT + 10):
        steps.choose(f"r{number}", 1)
    again = Steps(tmp_path / "steps.json")
    assert again.get("r0", 3) == 3
    assert again.get(f"r{KEPT + 9}", 3) == 1


@pytest.mark.parametrize("text", ["", "[]", "7", '{"arm-1": -1, "arm-2": "x", "arm-3": null}', "\0\xff{"])
def test_a_file_with_nonsense_is_no_file(tmp_path: Path, text: str) -> None:
    file = tmp_path / "steps.json"
    file.write_text(text, encoding="latin-1")
    assert [Steps(file).get(f"arm-{number}", 3) for number in (1, 2, 3)] == [3, 3, 3]


def test_where_nothing_can_be_kept_a_choice_holds_until_the_end(tmp_path: Path) -> None:
    steps = Steps(tmp_path / "no" / "folder" / "steps.json")
    steps.choose("arm-1", 2)
    assert steps.get("arm-1", 3) == 2
