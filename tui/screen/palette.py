"""Colours for terminals with 256 of them: greys stay grey. Pure.

Such a terminal has a cube of 6 x 6 x 6 colours and a ramp of 24 greys (xterm's palette). Rich takes the
nearest corner of the cube for whatever is a little tinted, so that dark greys become navy blue and pictures
of grey tables become green. So what is almost grey is made grey before, and all else a corner of the cube.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

from textual.color import Color
from textual.theme import Theme

Triplet = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

LEVELS = (0, 95, 135, 175, 215, 255)
"""Of each channel of the cube."""
COLOURS = ("primary", "secondary", "accent", "foreground", "background", "surface", "panel", "success",
           "warning", "error")  # fmt: skip
"""Colours of every theme, as Textual names them."""
TINT = 32
"""Difference between the channels up to which a colour counts as grey."""


@lru_cache(maxsize=8192)
def reduced(colour: Triplet) -> Triplet:
    """Return a colour that a terminal of 256 colours can show: a grey, or a corner of the cube."""
    if max(colour) - min(colour) <= TINT:
        grey = round(sum(colour) / 3)
        return grey, grey, grey
    reds, greens, blues = (sorted(LEVELS, key=lambda level: abs(level - part))[:2] for part in colour)
    corners = ((red, green, blue) for red in reds for green in greens for blue in blues)
    return min(corners, key=lambda corner: _distance(colour, corner))


def _distance(one: Triplet, other: Triplet) -> int:
    """Return how different two colours look: in their channels, and in what lies between these, the hue."""
    red, green, blue = (a - b for a, b in zip(one, other, strict=True))
    channels = red**2 + green**2 + blue**2
    return channels + (red - green) ** 2 + (green - blue) ** 2 + (blue - red) ** 2


def reduced_theme(theme: Theme) -> Theme:
    """Return a theme whose colours a terminal of 256 colours can show; its name ends with `-256`."""
    variables = {
        name: _reduced(value) if value.startswith("#") else value for name, value in theme.variables.items()
    }
    colours: dict[str, Any] = {name: _reduced(getattr(theme, name)) for name in COLOURS}
    return replace(theme, name=f"{theme.name}-256", variables=variables, **colours)


def _reduced(colour: str | None) -> str:
    parsed = Color.parse(colour or "#000000")
    return Color(*reduced((parsed.r, parsed.g, parsed.b))).hex
