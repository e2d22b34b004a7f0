"""A terminal of 256 colours: greys stay grey, in the theme and in pictures."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.color import Color, ColorSystem
from textual.theme import Theme

from robotree.tui.screen.palette import LEVELS, TINT, reduced
from robotree.tui.screen.themes import COLOUR_BLIND, DARK, LIGHT, OURS, REDUCED, chosen

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
