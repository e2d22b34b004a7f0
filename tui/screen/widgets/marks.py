"""Signs and colours of states: one sign for each, so that colour is never the only difference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.style import Style
from rich.text import Text
from textual.app import App
from textual.color import Color

from robotree.tui.seen.status import CALM, Status
from robotree.tui.seen.store import Weight
from robotree.tui.words import say_state

STATUSES: Mapping[Status, tuple[str, str]] = {
    "hangs": ("✗", "error"),
    "gone": ("✗", "error"),
    "late": ("◔", "warning"),
    "silent": ("◌", "warning"),
    "offline": ("✗", "error"),
    "stopped": ("■", "error"),
    "abandoned": ("▲", "error"),
    "paused": ("‖", "warning"),
    "busy": ("◐", "accent"),
    "waits": ("◍", "warning"),
    "moving": ("→", "accent"),
    "needs": ("○", "warning"),
    "away": ("◇", "muted"),
    "free": ("●", "success"),
    "enslaved": ("◆", "primary"),
}
"""Sign and colour (a variable of the theme) by status."""

WEIGHTS: Mapping[Weight, tuple[str, str]] = {
    "good": ("✓", "success"),
    "plain": ("·", "muted"),
    "warning": ("!", "warning"),
    "error": ("✗", "error"),
}
"""Sign and colour by the weight of a happening."""


FADE = 0.45
"""How far muted text goes from the foreground towards the background."""
DIM = Style(dim=True)
"""Of muted text in a list: halfway to the background of its line, also where that is the chosen one's."""

_styles: dict[tuple[str, str, bool], Style] = {}
"""By theme, variable and weight: to make one costs more than to draw with it."""


def tint(app: App[Any], variable: str, *, bold: bool = False) -> Style:
    """Return a variable of the theme as a style for Rich text; `muted` is made from two of them."""
    asked = (app.theme, variable, bold)
    if asked not in _styles:
        _styles[asked] = Style(color=_colour(app.theme_variables, variable).rich_color, bold=bold)
    return _styles[asked]


def tint_on_panel(app: App[Any], variable: str, *, bold: bool = False) -> Style:
    """Return a variable of the theme as a style on the colour of panels, and of the line under the cursor."""
    own = f"{variable}-on-panel"
    return tint(app, own if own in app.theme_variables else variable, bold=bold)


def block(app: App[Any]) -> Style:
    """Return the style of what must be seen first: a red block; without colours a reversed one."""
    if app.no_color:
        return Style(bold=True, reverse=True)
    variables = app.theme_variables
    ground = Color.parse(variables.get("stop", variables["error"]))
    return Style(color=ground.get_contrast_text(1.0).rich_color, bgcolor=ground.rich_color, bold=True)


def _colour(variables: Mapping[str, str], variable: str) -> Color:
    if variable == "muted":
        return Color.parse(variables["foreground"]).blend(Color.parse(variables["background"]), FADE)
    return Color.parse(variables[variable])


def status_mark(app: App[Any], status: Status, words: str) -> Text:
    """Return a status as sign and words, in the language of the reader."""
    sign, variable = STATUSES[status]
    style = tint(app, variable)
    return Text.assemble((f"{sign} ", style), (say_state(words), style if status not in CALM else ""))


def weigh(app: App[Any], weight: Weight, words: str) -> Text:
    """Return a happening as sign and words."""
    sign, variable = WEIGHTS[weight]
    style = tint(app, variable)
    return Text.assemble((f"{sign} ", style), (words, style if weight in {"warning", "error"} else ""))
