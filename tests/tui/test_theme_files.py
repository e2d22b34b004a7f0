"""Colours of an operator's own: what a file may say, and the sentence for each mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.errors import BadTheme
from robotree.tui.screen import themes
from robotree.tui.screen.themes import DARK, LIGHT, SIXTEEN, chosen, read


def test_a_file_changes_the_colours_that_it_names_and_no_others() -> None:
    theme = read('based-on = "light"\n[colours]\nprimary = "#005f87"\nstop = "red"\n', "desk", "desk.toml")
    assert theme.name == "desk"
    assert theme.primary == "#005F87"
    assert theme.error == LIGHT.error
    assert theme.variables["stop"] == "#FF0000"
    assert not theme.dark


def test_a_terminal_of_fewer_colours_shows_it_reduced_or_the_nearest_of_ours() -> None:
    theme = read('[colours]\nprimary = "#123456"\n', "desk", "desk.toml")
    assert chosen("desk", "truecolor", [theme]) is theme
    assert chosen("desk", "256", [theme]).name == "desk-256"
    assert chosen("desk", "standard", [theme]) is SIXTEEN[DARK.name]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("primary = ", "it is no TOML"),
        ("[colors]\n", "'colors' means nothing here"),
        ('based-on = "neon"', "there is no theme 'neon' to begin with; there are dark, light, colour-blind"),
        ("colours = 3", "colours must be a table"),
        ('[colours]\nprimry = "red"', "no colour is named 'primry'; did you mean primary"),
        ('[colours]\nprimary = "reddish-brown"', "primary: 'reddish-brown' is no colour"),
        ("[colours]\nprimary = 3", "primary: 3 is no colour"),
        ('[colours]\nforeground = "#222222"', "foreground on background cannot be read"),
        ('[colours]\nerror = "#201010"', "error on background cannot be read"),
    ],
)
def test_a_file_that_is_wrong_anywhere_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(BadTheme) as refused:
        read(text, "desk", "~/desk.toml")
    assert str(refused.value).startswith("~/desk.toml: ")
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value).partition(": ")[0]


def test_files_are_found_beside_the_file_of_keys_and_cannot_replace_themes_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert themes.load() == ()
    themes.folder().mkdir(parents=True)
    (themes.folder() / "desk.toml").write_text('[colours]\nprimary = "#ffffff"\n')
    assert [theme.name for theme in themes.load()] == ["desk"]
    (themes.folder() / "light.toml").write_text("")
    with pytest.raises(BadTheme, match="light is a theme of robotree"):
        themes.load()
