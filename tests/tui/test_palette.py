"""Colours: greys stay grey on a terminal of 256, and a file of an operator changes what it names."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.color import Color, ColorSystem
from textual.theme import Theme

from robotree.tui.errors import BadTheme
from robotree.tui.screen import themes
from robotree.tui.screen.palette import LEVELS, TINT, reduced
from robotree.tui.screen.themes import COLOUR_BLIND, DARK, LIGHT, OURS, REDUCED, SIXTEEN, chosen, read

CHANNEL = st.integers(0, 255)


def shown(colour: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return what a terminal of 256 colours shows, by Rich's own way to choose among them."""
    return tuple(Color.from_rgb(*colour).downgrade(ColorSystem.EIGHT_BIT).get_truecolor())  # type: ignore[return-value]


@given(grey=st.integers(14, 241), red=st.integers(0, TINT // 2), blue=st.integers(0, TINT // 2))
def test_what_is_almost_grey_is_shown_grey(grey: int, red: int, blue: int) -> None:
    seen = shown(reduced((grey + red, grey, grey - blue)))
    assert len(set(seen)) == 1, "no tint"
    assert abs(seen[0] - grey) <= 20


@given(red=CHANNEL, green=CHANNEL, blue=CHANNEL)
def test_every_colour_is_one_that_the_terminal_has(red: int, green: int, blue: int) -> None:
    found = reduced((red, green, blue))
    grey = len(set(found)) == 1
    assert grey or (set(found) <= set(LEVELS) and shown(found) == found)


@pytest.mark.parametrize("theme", OURS, ids=lambda theme: theme.name)
def test_the_grounds_of_a_theme_stay_grey_and_its_reds_red(theme: Theme) -> None:
    small = REDUCED[theme.name]
    for colour in (small.background, small.surface, small.panel):
        red, green, blue = Color.parse(str(colour)).get_truecolor()
        assert red == green == blue
    for name in ("stop", "banner"):
        ground = tuple(Color.parse(small.variables[name]).get_truecolor())
        red, green, blue = shown(ground)
        assert (red, green, blue) == ground, "the terminal has it"
        assert red > green >= blue, "red, neither grey nor purple"
    red, green, blue = Color.parse(str(small.error)).get_truecolor()
    assert red > max(green, blue), "no other colour is as strong"
    assert blue <= green, "it is not pink"


@pytest.mark.parametrize(
    ("wanted", "system", "found"),
    [
        ("", "truecolor", DARK.name),
        ("light", "truecolor", LIGHT.name),
        ("robotree-colour-blind", "256", f"{COLOUR_BLIND.name}-256"),
        ("", None, f"{DARK.name}-256"),
        ("no such theme", "256", f"{DARK.name}-256"),
    ],
)
def test_a_terminal_gets_the_theme_that_it_can_show(wanted: str, system: str | None, found: str) -> None:
    assert chosen(wanted, system).name == found


@pytest.mark.parametrize("theme", [DARK, LIGHT, COLOUR_BLIND], ids=lambda theme: theme.name)
def test_no_state_is_red_on_blue_on_a_terminal_of_sixteen(theme: Theme) -> None:
    small = chosen(theme.name, "standard")
    for variable in ("error", "success", "accent"):
        text = Color.parse(
            small.variables.get(f"{variable}-on-panel", getattr(small, variable))
        ).get_truecolor()
        is_red = text.red > 2 * max(text.green, text.blue)
        for name in (small.panel, small.variables["block-cursor-background"]):
            ground = Color.parse(str(name)).get_truecolor()
            assert not (is_red and ground.blue > 2 * max(ground.red, ground.green)), (variable, name)


@pytest.mark.parametrize("theme", [DARK, LIGHT, COLOUR_BLIND], ids=lambda theme: theme.name)
def test_states_keep_different_colours_on_a_terminal_of_sixteen(theme: Theme) -> None:
    small = chosen(theme.name, "standard")
    names = ("success", "error", "accent", "primary", "foreground", "background")
    numbers = {
        name: Color.parse(str(getattr(small, name))).downgrade(ColorSystem.STANDARD).number for name in names
    }
    assert len(set(numbers.values())) == len(names), numbers


# -- colours of an operator's own: what a file may say, and the sentence for each mistake ----------


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
