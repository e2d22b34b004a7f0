"""How a person has arranged the screen is so after a restart; a file that is none is named and left alone."""

from __future__ import annotations

from pathlib import Path

import pytest

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
