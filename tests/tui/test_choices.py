"""What was chosen last on the screen is so after a restart, and no file can harm it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.processes.choices import KEPT, Choices


def test_a_choice_is_the_same_after_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "choices.json"
    choices = Choices(file)
    choices.choose("arm-1", 5)
    choices.choose("arm-2", 0)
    choices.choose("theme", "desk")
    again = Choices(file)
    assert (again.get("arm-1", 3), again.get("arm-2", 3), again.get("arm-3", 3)) == (5, 0, 3)
    assert (again.get("theme", ""), again.get("language", ""), again.get("theme", 3)) == ("desk", "", 3)


def test_only_the_last_choices_are_kept(tmp_path: Path) -> None:
    choices = Choices(tmp_path / "choices.json")
    for number in range(KEPT + 10):
        choices.choose(f"r{number}", 1)
    again = Choices(tmp_path / "choices.json")
    assert again.get("r0", 3) == 3
    assert again.get(f"r{KEPT + 9}", 3) == 1


@pytest.mark.parametrize("text", ["", "[]", "7", '{"arm-1": -1}', '{"arm-1": null, "theme": {}}', "\0\xff{"])
def test_a_file_with_nonsense_is_no_file(tmp_path: Path, text: str) -> None:
    file = tmp_path / "choices.json"
    file.write_text(text, encoding="latin-1")
    assert (Choices(file).get("arm-1", 3), Choices(file).get("theme", "")) == (3, "")


def test_a_bad_entry_is_left_out_alone(tmp_path: Path) -> None:
    file = tmp_path / "choices.json"
    file.write_text('{"arm-1": 5, "arm-2": -1, "arm-3": true, "arm-4": null, "theme": "desk"}')
    choices = Choices(file)
    assert [choices.get(f"arm-{number}", 3) for number in (1, 2, 3, 4)] == [5, 3, 3, 3]
    assert choices.get("theme", "") == "desk"


def test_where_nothing_can_be_kept_a_choice_holds_until_the_end(tmp_path: Path) -> None:
    choices = Choices(tmp_path / "no" / "folder" / "choices.json")
    choices.choose("arm-1", 2)
    assert choices.get("arm-1", 3) == 2
