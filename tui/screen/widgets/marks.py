"""Signs and colours of states: one sign for each, so that colour is never the only difference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.style import Style
from rich.text import Text
from textual.app import App
from textual.color import Color

from robotree.tui.seen.mood import CALM, Mood
from robotree.tui.seen.store import Weight

MOODS: Mapping[Mood, tuple[str, str]] = {
    "free": ("●", "success"),
    "busy": ("◐", "accent"),
    "enslaved": ("◆", "primary"),
    "stopped": ("■", "error"),
    "offline": ("✗", "error"),
    "abandoned": ("▲", "error"),
    "silent": ("◌", "warning"),
}
"""Sign and colour (a variable of the theme) by mood."""

WEIGHTS: Mapping[Weight, tuple[str, str]] = {
    "good": ("✓", "success"),
    "plain": ("·", "muted"),
    "warning": ("!", "warning"),
    "error": ("✗", "error"),
}
"""Sign and colour by the weight of a happening."""


FADE = 0.45
"""How far muted text goes from the foreground towards the background."""


def tint(app: App[Any], variable: str, *, bold: bool = False) -> Style:
    """Return a variable of the theme as a style for Rich text; `muted` is made from two of them."""
    variables = app.theme_variables
    if variable == "muted":
        faded = Color.parse(variables["foreground"]).blend(Color.parse(variables["background"]), FADE)
        return Style(color=faded.rich_color, bold=bold)
    return Style(color=Color.parse(variables[variable]).rich_color, bold=bold)


def mood_mark(app: App[Any], mood: Mood, words: str) -> Text:
    """Return a mood as sign and words."""
    sign, variable = MOODS[mood]
    style = tint(app, variable)
    return Text.assemble((f"{sign} ", style), (words, style if mood not in CALM else ""))


def weigh(app: App[Any], weight: Weight, words: str) -> Text:
    """Return a happening as sign and words."""
    sign, variable = WEIGHTS[weight]
    style = tint(app, variable)
    return Text.assemble((f"{sign} ", style), (words, style if weight in {"warning", "error"} else ""))
