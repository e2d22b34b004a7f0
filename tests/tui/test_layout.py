"""How a person has arranged the screen, and what was chosen there, is so after a restart."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.processes.choices import KEPT, Choices
from robotree.tui.processes.layout import Layout, LayoutFile


def test_an_arrangement_is_the_same_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "screen.yaml"
    LayoutFile(path).change(sort="problems", share=60, filters={"night": "state:stopped !rover"})
    again = LayoutFile(path)
    assert again.layout == Layout(sort="problems", share=60, filters={"night": "state:stopped !rover"})
    assert "night: state:stopped !rover" in path.read_text()


def test_two_screens_of_one_person_keep_what_each_has_changed(tmp_path: Path) -> None:
    path = tmp_path / "screen.yaml"
    one, other = LayoutFile(path), LayoutFile(path)
    one.change(sort="kind")
    other.change(divide="site")
    assert LayoutFile(path).layout == Layout(sort="kind", divide="site")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("page: [robots\nsort: x: y\n", "no YAML in line 2"),
        ("\0\xff", "no YAML"),
        ("- robots\n", "Expected `object`, got `array`"),
        ("paeg: robots\n", "unknown field `paeg`"),
        ("sort: colour\n", "sort: 'colour' is none of tree, problems"),
        ("share: 99\n", "share: 99 is not from 20 to 80"),
        ("wide: perhaps\n", "Expected `bool`, got `str`"),
    ],
)
def test_a_file_that_is_no_layout_is_one_sentence_and_the_usual_one(
    tmp_path: Path, text: str, reason: str
) -> None:
    path = tmp_path / "screen.yaml"
    path.write_text(text, encoding="latin-1")
    found = LayoutFile(path)
    assert reason in found.fault
    assert str(path) in found.fault
    assert "\n" not in found.fault
    assert found.layout == Layout()
    found.change(sort="kind")
    assert path.read_text(encoding="latin-1") == text, "it is left for a person to mend"
    assert found.layout.sort == "kind", "until the end it holds"


# -- what was chosen last on the screen is so after a restart, and no file can harm it -------------


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
